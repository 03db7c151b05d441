"""From a start to a calibration: the free parameters, the problem, the search, the residuals."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial import cKDTree

from camcal.data.observations import Observations
from camcal.errors import DataError, EstimationError
from camcal.model.camera import Camera
from camcal.model.pose import Array, Poses
from camcal.solve import optimizers
from camcal.solve.board import BoardProblem, make_board, settle
from camcal.solve.calibration import Calibration, Fit, NormalBlocks, ShapedBoard
from camcal.solve.optimizers.base import OnStep, Options, Result
from camcal.solve.parameters import apply_fixed, free_matrix
from camcal.solve.problem import Problem

#: points of a board nearer to one another than this part of its coordinates are one, printed with few digits
_SAME_POINT = 1e-6
#: points that are projected in one go: a lens model has some 20 numbers a point in use, which then stay in a cache of
#: a few MB
POINTS_AT_A_TIME = 16_000


@dataclass(frozen=True)
class How:
    """How a fit is made, the same for every fit of a calibration.

    Attributes
    ----------
    fix : mapping
        Parameter -> value, or None to hold it where it starts; `aspect` holds fy / fx.
    optimizer : str
        Of the table of optimisers.
    stopping : Options
        When the search ends.
    normalise : bool
        See `Problem`.
    board : str
        `flat` = as the observations say; `bowl`, `print` and `free` are estimated along.
    """

    fix: Mapping[str, float | None] = field(default_factory=dict)
    optimizer: str = "lm"
    stopping: Options | None = None
    normalise: bool = True
    board: str = "flat"


def refine(
    start: Camera,
    poses: Poses,
    observations: Observations,
    how: How | None = None,
    on_step: OnStep | None = None,
) -> Calibration:
    """Estimate the camera and all poses by maximum likelihood, from a start.

    Parameters
    ----------
    start : Camera
    poses : Poses
        cam_from_board of each view.
    observations : Observations
        The fit rests on the rows that are `used`, weighted by their `precision`; the others get residuals only.
    how : How, optional

    Returns
    -------
    Calibration
        Where a board's shape was estimated, its observations hold the points found.

    Raises
    ------
    DataError
        Where a view has no point left.
    EstimationError
        Where there are fewer observations than parameters, or the start does not project.
    """
    begin = time.perf_counter()
    how = how or How()
    params = apply_fixed(start.lens, start.params, how.fix)
    start = replace(start, params=params)
    free = free_matrix(start.lens, params, how.fix)
    problem = make_problem(start, observations, free, how)
    result: Result = optimizers.make(how.optimizer)(
        problem, problem.state(params, poses), how.stopping, on_step
    )
    found = replace(start, params=result.state.params)
    final, board = problem.poses(result.state), None
    if isinstance(problem, BoardProblem):
        shape = problem.board
        points, final = settle(shape.points + shape.expand(result.state.shape), shape.points, final)
        observations = on_board(observations, shape.points, points)
        free = np.c_[free, np.zeros((len(free), shape.size))]
        board = ShapedBoard(shape.kind, shape.points, points, shape.size, shape.basis)
    return Calibration(
        camera=found,
        poses=final,
        observations=observations,
        residuals=residuals(found, final, observations),
        start=start,
        free=free,
        normal=_normal(problem, result),
        fit=_fit(how.optimizer, result, time.perf_counter() - begin),
        board=board,
    )


def make_problem(camera: Camera, observations: Observations, free: Array, how: How) -> Problem:
    """The least squares problem of the used rows; with a board's shape where `how` says so.

    Raises
    ------
    DataError, EstimationError
        As `refine`.
    """
    kept = observations.kept()
    _check_count(kept, free)
    precision = kept.precision
    weights = None if precision is None else kept.split(precision)
    if how.board == "flat":
        return Problem(camera.lens, kept.views, free, weights, how.normalise)
    return BoardProblem(
        camera.lens, kept.views, free, make_board(kept.views, how.board), weights, how.normalise
    )


def on_board(observations: Observations, ideal: Array, points: Array) -> Observations:
    """The observations with the ideal points (M, 3) replaced by those found (M, 3).

    Points that are none of the ideal ones (no view that was used shows them) stay where they are.
    """
    near = _SAME_POINT * float(np.abs(ideal).max(initial=0.0))
    distance, index = (np.asarray(a) for a in cKDTree(ideal).query(observations.xyz))
    moved = np.where(distance[:, None] <= near, points[index], observations.xyz)
    return replace(observations, xyz=moved)


def as_designed(calibration: Calibration) -> Observations:
    """The observations of a calibration with the board as it was given to it."""
    board, data = calibration.board, calibration.observations
    return data if board is None else on_board(data, board.points, board.ideal)


def residuals(camera: Camera, poses: Poses, observations: Observations) -> Array:
    """Predicted - observed (N, 2) of every row, px; NaN outside the lens's domain. Poses are those of the views."""
    found = np.empty_like(observations.uv)
    counts, slices = observations.blocks.counts, observations.slices
    rotations, translations = poses.rotations, poses.translations
    begin = 0
    for end in _portions(counts.tolist()):
        rows = slice(slices[begin].start, slices[end - 1].stop)
        some, xyz = counts[begin:end], observations.xyz[rows]
        r, t = rotations[begin:end], translations[begin:end]
        if some.min() == some.max():  # in one go: for small views the calls would cost more than the work
            cam = (xyz.reshape(len(some), -1, 3) @ r.transpose(0, 2, 1) + t[:, None]).reshape(-1, 3)
        else:
            cam = np.einsum("nij,nj->ni", np.repeat(r, some, 0), xyz) + np.repeat(t, some, 0)
        found[rows] = camera.project(cam) - observations.uv[rows]
        begin = end
    return found


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


def _check_count(kept: Observations, free: Array) -> None:
    if (kept.blocks.counts == 0).any():
        raise DataError("a view has no point left.", "Leave that view out.")
    observed, unknown = 2 * kept.point_count, free.shape[1] + 6 * len(kept)
    if observed < unknown:
        raise EstimationError(
            f"{observed // 2} points give {observed} coordinates for {unknown} unknowns "
            f"({free.shape[1]} of the camera and {6 * len(kept)} of the poses).",
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
