"""From a start to a `Solution`: the free parameters, the problem, the optimiser, the residuals."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from camcal.data.observations import Correspondences
from camcal.errors import DataError, EstimationError
from camcal.model.camera import Camera
from camcal.model.pose import Array, Poses
from camcal.solve import optimizers
from camcal.solve.board import BoardProblem, make_board, settle
from camcal.solve.optimizers.base import OnStep, Options, Result
from camcal.solve.parameters import apply_fixed, free_matrix
from camcal.solve.problem import Problem
from camcal.solve.solution import Fit, NormalBlocks, Solution

#: points of a board nearer to one another than this part of its coordinates are one, printed with few digits
_SAME_POINT = 1e-6
#: that are projected in one go: a lens model has some 20 numbers a point in use
POINTS_AT_A_TIME = 16_000


def refine(
    start: Camera,
    poses: Poses,
    correspondences: Correspondences,
    fix: Mapping[str, float | None] | None = None,
    optimizer: str = "lm",
    options: Options | None = None,
    inliers: Sequence[Array] | None = None,
    weights: Sequence[Array] | None = None,
    board_shape: str = "flat",
    on_step: OnStep | None = None,
    normalise: bool = True,
) -> Solution:
    """Estimate the camera and all poses by maximum likelihood, from a start.

    Parameters
    ----------
    start : Camera
    poses : Poses
        cam_from_board of each view.
    fix : mapping
        Parameter -> value, or None to hold it where it starts; `aspect` holds fy / fx.
    inliers : sequence of (N,) bool arrays, optional
        Points to rest on; the others get residuals only.
    weights : sequence of (N,) arrays, optional
        Weights of the squared residuals in place of 1 / sigma²; as long as the views, all points.
    board_shape : str
        `flat` = as the correspondences say; `bowl`, `print` and `free` are estimated along. The solution's
        correspondences then hold the points found, and `extras["board"]` the ideal ones with their ids.
    normalise : bool
        See `Problem`.

    Raises
    ------
    EstimationError
        Where there are fewer observations than parameters, or the start does not project.
    """
    begin = time.perf_counter()
    fix = fix or {}
    lens, views = start.lens, correspondences.views
    masks = tuple(np.ones(len(v), bool) for v in views) if inliers is None else tuple(inliers)
    params = apply_fixed(lens, start.params, fix)
    start = replace(start, params=params)
    free = free_matrix(lens, params, fix)
    kept = [v if m.all() else v.take(m) for v, m in zip(views, masks, strict=True)]
    _check_count(kept, free)
    kept_weights = None if weights is None else [w[m] for w, m in zip(weights, masks, strict=True)]
    board = None if board_shape == "flat" else make_board(kept, board_shape)
    problem = (
        Problem(lens, kept, free, kept_weights, normalise)
        if board is None
        else BoardProblem(lens, kept, free, board, kept_weights, normalise)
    )
    result: Result = optimizers.make(optimizer)(problem, problem.state(params, poses), options, on_step)
    found = replace(start, params=lens.normalise(result.state.params))
    final = problem.poses(result.state)
    extras: dict[str, Any] = {}
    if board is not None:
        points, final = settle(board.points + board.expand(result.state.shape), board.points, final)
        correspondences = on_board(correspondences, board.points, points)
        free = np.c_[free, np.zeros((len(free), board.size))]
        extras["board"] = BoardResult(board.kind, board.points, points, board.size, board.basis)
    return Solution(
        camera=found,
        poses=final,
        correspondences=correspondences,
        residuals=residuals(found, final, correspondences),
        inliers=masks,
        start=start,
        free=free,
        normal=_normal(problem, result),
        fit=_fit(optimizer, result, time.perf_counter() - begin),
        extras=extras,
    )


@dataclass(frozen=True)
class BoardResult:
    """The board that was found.

    Attributes
    ----------
    kind : str
    ideal : (M, 3) array
        The points that the correspondences gave, unit of the data.
    points : (M, 3) array
        Where they are, in the frame and at the scale in which they are nearest to the ideal ones.
    size : int
        Number of parameters of the shape.
    basis : (3 M, B) array, or (B,) int array
        As in `Board`.
    """

    kind: str
    ideal: Array
    points: Array
    size: int
    basis: Array | None = None

    def directions(self) -> Array:
        """d X / d θ (3 M, B) in full."""
        assert self.basis is not None
        return self.basis if self.basis.ndim == 2 else np.eye(3 * len(self.points))[:, self.basis]


def on_board(correspondences: Correspondences, ideal: Array, points: Array) -> Correspondences:
    """The correspondences with the ideal points (M, 3) replaced by those found (M, 3).

    Points that are none of the ideal ones (no view that was used shows them) stay where they are.
    """
    tree = cKDTree(ideal)
    near = _SAME_POINT * float(np.abs(ideal).max(initial=0.0))

    def moved(xyz: Array) -> Array:
        distance, index = (np.asarray(a) for a in tree.query(xyz))
        return np.where(distance[:, None] <= near, points[index], xyz)

    views = tuple(replace(v, xyz=moved(v.xyz)) for v in correspondences.views)
    return replace(correspondences, views=views)


def residuals(camera: Camera, poses: Poses, correspondences: Correspondences) -> tuple[Array, ...]:
    """Predicted - observed (N, 2) of every point of each view, px; NaN outside the lens's domain."""
    found: list[Array] = []
    views = correspondences.views
    begin = 0
    for end in _portions([len(v) for v in views]):
        some, counts = views[begin:end], [len(v) for v in views[begin:end]]
        xyz = np.concatenate([v.xyz for v in some])
        r, t = poses.rotations[begin:end], poses.translations[begin:end]
        if min(counts) == max(counts):  # in one go: for small views the calls would cost more than the work
            cam = (xyz.reshape(len(some), -1, 3) @ r.transpose(0, 2, 1) + t[:, None]).reshape(-1, 3)
        else:
            cam = np.einsum("nij,nj->ni", np.repeat(r, counts, 0), xyz) + np.repeat(t, counts, 0)
        off = camera.project(cam) - np.concatenate([v.uv for v in some])
        ends = np.cumsum(counts)
        found += [off[a:b] for a, b in zip([0, *ends[:-1]], ends, strict=True)]
        begin = end
    return tuple(found)


def _portions(counts: Sequence[int]) -> Iterator[int]:
    """Where to cut views into portions whose points fit into a cache: their ends."""
    points = 0
    for index, count in enumerate(counts):
        if points and points + count > POINTS_AT_A_TIME:
            yield index
            points = 0
        points += count
    if counts:
        yield len(counts)


def _check_count(views: Sequence, free: Array) -> None:
    if any(len(v) == 0 for v in views):
        raise DataError("a view has no point left.", "Leave that view out.")
    observed, unknown = 2 * sum(len(v) for v in views), free.shape[1] + 6 * len(views)
    if observed < unknown:
        raise EstimationError(
            f"{observed // 2} points give {observed} coordinates for {unknown} unknowns "
            f"({free.shape[1]} of the camera and {6 * len(views)} of the poses).",
            "Add points or views, hold parameters (--fix), or choose a simpler model (--model pinhole).",
        )


def _normal(problem: Problem, result: Result) -> NormalBlocks:
    """The blocks at the solution, with poses about the centroids also where the search had them elsewhere."""
    if problem.normalise:
        return result.blocks.normal()
    usual = problem.normalised()
    state = usual.state(result.state.params, problem.poses(result.state))
    blocks = usual.linearise(replace(state, shape=result.state.shape))
    assert blocks is not None  # the same place, where the problem has just been linearised
    return blocks.normal()


def _fit(optimizer: str, result: Result, seconds: float) -> Fit:
    return Fit(
        optimizer=optimizer,
        loss="linear",
        iterations=result.iterations,
        evaluations=result.evaluations,
        converged=result.converged,
        stop_reason=result.stop_reason,
        cost=result.blocks.cost,
        seconds=seconds,
        trace=result.trace,
        samples=result.samples,
        info=result.info,
    )
