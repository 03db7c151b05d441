"""From a start to a calibration: the free parameters, the problem, the search, the residuals."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field, replace
from typing import Any, NamedTuple, TypeVar, cast, overload

import numpy as np

from camcal.data.boards import moved, parts
from camcal.data.observations import Observations
from camcal.errors import DataError, EstimationError
from camcal.model.camera import Camera
from camcal.model.pose import Array, Poses
from camcal.model.rig import Rig
from camcal.records import dataclass
from camcal.solve import optimizers
from camcal.solve.board import PLACED, BoardProblem, make_board, settle
from camcal.solve.board_points import shaped, shaped_board
from camcal.solve.calibration import Calibration, Estimate, Fit, NormalBlocks, RigCalibration, ShapedBoard
from camcal.solve.optimizers.base import OnStep, Options, Result
from camcal.solve.parameters import free_matrix
from camcal.solve.problem import Problem, Seen, State
from camcal.solve.several_boards import Several, motions_of
from camcal.solve.subject import cameras_of, fixes, rig_poses, solved_for, with_fixed

#: rad; boards that rotated by less in the last round have converged: the linearisation error is the square of this
SMALL_TURN = 1e-6
#: rounds with placed boards: the rotations of a round are the squares of those before, so that three suffice from .1
#: rad
ROUNDS = 8
#: points projected at a time: a lens model uses some 20 numbers per point, which then fit into a cache of a few MB
POINTS_AT_A_TIME = 16_000


@dataclass(frozen=True)
class How:
    """The settings of a fit, the same for every fit of a calibration.

    Attributes
    ----------
    fix : mapping
        Parameter -> value, or None to hold it at its initial value; `aspect` holds fy / fx.
    optimizer : str
        Of the table of optimisers.
    stopping : Options
        When the search ends.
    normalise : bool
        See `Problem`.
    board : str
        `flat` = as in the observations; `bowl`, `print` and `free` are estimated jointly.
    hold_rig : bool
        Whether the poses of a rig's cameras are held.
    """

    fix: Mapping[str, float | None] = field(default_factory=dict)
    optimizer: str = "lm"
    stopping: Options | None = None
    normalise: bool = True
    board: str = "flat"
    hold_rig: bool = False


@overload
def refine(
    start: Camera,
    poses: Poses,
    observations: Observations,
    how: How | None = None,
    on_step: OnStep | None = None,
) -> Calibration: ...


@overload
def refine(
    start: Rig,
    poses: Poses,
    observations: Observations,
    how: How | None = None,
    on_step: OnStep | None = None,
) -> RigCalibration: ...


def refine(
    start: Camera | Rig,
    poses: Poses,
    observations: Observations,
    how: How | None = None,
    on_step: OnStep | None = None,
) -> Calibration | RigCalibration:
    """Estimate a camera or a rig and all poses by maximum likelihood, from a start.

    Parameters
    ----------
    start : Camera or Rig
        The cameras of a rig in the order of the observations, the reference first.
    poses : Poses
        cam_from_board of each view; for a rig, rig_from_board of each instant.
    observations : Observations
        The fit uses the rows that are `used`, weighted by their `precision`; for the others only residuals are
        computed.
    how : How, optional
        For a rig, `fix` names parameters as `left.fx`.

    Returns
    -------
    Calibration, or RigCalibration of a rig
        If a board's shape was estimated, its observations hold the estimated points.

    Raises
    ------
    DataError
        If a view has no points left.
    EstimationError
        If there are fewer observations than parameters, or the start does not project.
    """
    begin = time.perf_counter()
    how = how or How()
    start, frees, problem, state = posed(start, poses, observations, how)
    result: Result = optimizers.make(how.optimizer)(problem, state, how.stopping, on_step)
    if isinstance(problem, BoardProblem) and problem.board.placed:
        problem, result, observations = _placed(problem, result, observations, cameras_of(start), frees, how)
    return calibration(start, problem, result, observations, how.optimizer, time.perf_counter() - begin)


class Posed(NamedTuple):
    """A refinement to be run: the start with the held values applied, the matrices (P, F) of its free parameters, the
    problem, and its first state.
    """

    start: Camera | Rig
    frees: list[Array]
    problem: Problem
    state: State


def posed(start: Camera | Rig, poses: Poses, observations: Observations, how: How) -> Posed:
    """The problem of a refinement.

    Raises
    ------
    DataError, EstimationError
        As `refine`.
    """
    start = with_fixed(start, how.fix)
    cameras = cameras_of(start)
    frees = [free_matrix(c.lens, c.params, f) for c, f in zip(cameras, fixes(start, how.fix), strict=True)]
    problem = make_problem(cameras, observations, frees, how)
    params = np.concatenate([c.params for c in cameras])
    return Posed(start, frees, problem, problem.state(params, poses, rig_poses(start)))


def calibration(
    start: Camera | Rig,
    problem: Problem,
    result: Result,
    observations: Observations,
    optimizer: str,
    seconds: float,
) -> Calibration | RigCalibration:
    """The result of a search as a calibration, with the residuals of all rows."""
    final, board, scale = problem.poses(result.state), None, 1.0
    if isinstance(problem, BoardProblem):
        board, final, scale = _board_of(problem, result, final)
        observations = shaped(observations, board)
    found = solved_for(start, problem.params(result.state), result.state.rig, scale)
    common: dict[str, Any] = {
        "poses": final,
        "observations": observations,
        "residuals": residuals(found, final, observations),
        "free": np.c_[problem.free, np.zeros((len(problem.free), problem.variables - problem.free.shape[1]))],
        "normal": _normal(problem, result),
        "fit": _fit(optimizer, result, seconds),
        "board": board,
    }
    if isinstance(found, Rig):
        assert isinstance(start, Rig)
        return RigCalibration(rig=found, start=start, **common)
    assert isinstance(start, Camera)
    return Calibration(camera=found, start=start, **common)


def _board_of(problem: BoardProblem, result: Result, poses: Poses) -> tuple[ShapedBoard, Poses, float]:
    """The board that was found, the poses in its frame, and the factor of all lengths."""
    shape, theta, scale = problem.board, result.state.shape.copy(), 1.0
    theta[: shape.placed] = 0.0  # in the observations already
    points = shape.points + shape.expand(theta)
    if shape.label is None:  # the directions of several boards leave each of them in its place
        points, poses, scale = settle(points, shape.points, poses)
    return shaped_board(shape, points), poses, scale


def _placed(
    problem: Problem,
    result: Result,
    observations: Observations,
    cameras: Sequence[Camera],
    frees: Sequence[Array],
    how: How,
) -> tuple[Problem, Result, Observations]:
    """The fit with rigid boards, from one whose rotations were linearised: the boards are moved and the fit repeated.

    The rotations of a round are of second order in those of the previous one. Shapes restart in each round.
    """
    for _ in range(ROUNDS):
        assert isinstance(problem, BoardProblem) and problem.board.part is not None
        shape = problem.board
        places = result.state.shape[: shape.placed]
        observations = moved(observations, motions_of(places, shape.points, problem.board.part))
        poses, params = problem.poses(result.state), result.state.params
        problem = make_problem(cameras, observations, frees, how)
        state = problem.state(params, poses, result.state.rig)
        begin = result
        result = optimizers.make(how.optimizer)(problem, state, how.stopping, None)
        result = replace(
            result,
            iterations=begin.iterations + result.iterations,
            evaluations=begin.evaluations + result.evaluations,
        )
        turns = result.state.shape[: shape.placed].reshape(-1, 6)[:, :3]
        if np.abs(turns).max(initial=0.0) < SMALL_TURN:
            break
    return problem, result, observations


E = TypeVar("E", bound=Estimate)


def subject_of(fit: Estimate) -> Camera | Rig:
    """A description of what a fit estimated."""
    if isinstance(fit, RigCalibration):
        return fit.rig
    assert isinstance(fit, Calibration)
    return fit.camera


def refit(fit: E, observations: Observations, how: How, poses: Poses | None = None) -> E:
    """Fit again from a fit to other rows; `poses` if the views differ from the fit's."""
    poses = fit.poses if poses is None else poses
    found = refine(subject_of(fit), poses, observations, how)  # type: ignore[call-overload]
    return cast(E, found)


def make_problem(
    cameras: Sequence[Camera], observations: Observations, frees: Sequence[Array], how: How
) -> Problem:
    """The least-squares problem of the used rows; with a board's shape if `how` asks for one.

    Parameters
    ----------
    cameras : sequence of C Camera
    frees : sequence of C (P, F) arrays
        d params / d free parameters of each.

    Raises
    ------
    DataError, EstimationError
        As `refine`.
    """
    kept = observations.kept()
    _check_count(kept, frees, 0 if how.hold_rig else 6 * (len(frees) - 1))
    lenses, seen = [c.lens for c in cameras], Seen(kept.blocks.camera, kept.blocks.view)
    if how.board == "flat":
        return Problem(lenses, kept.views, frees, kept.precision_by_view, how.normalise, seen, how.hold_rig)
    board = make_board(kept.views, how.board, Several.of(kept))
    return BoardProblem(
        lenses, kept.views, frees, board, kept.precision_by_view, how.normalise, seen, how.hold_rig
    )


def board_kind(observations: Observations) -> str:
    """The kind of shape fitted to observations of one board as designed, or of several boards."""
    return "flat" if parts(observations) is None else PLACED


def placed_boards(observations: Observations) -> ShapedBoard | None:
    """The current points of boards that were placed together with the cameras; None if none was."""
    kept = observations.kept()
    if parts(kept) is None:
        return None
    board = make_board(kept.views, PLACED, Several.of(kept))
    return shaped_board(board, board.points)


def as_designed(calibration: Estimate) -> Observations:
    """The observations of a calibration with the original board."""
    board, data = calibration.board, calibration.observations
    return data if board is None else shaped(data, replace(board, ideal=board.points, points=board.ideal))


def residuals(camera: Camera | Rig, poses: Poses, observations: Observations) -> Array:
    """Predicted - observed (N, 2) of every row, px; NaN outside the lens's domain. `poses` are those of the views."""
    found = np.empty_like(observations.uv)
    if isinstance(camera, Camera):
        _fill(found, camera, poses, observations, 0)
        return found
    blocks = observations.blocks
    for index, (name, own) in enumerate(camera.cameras.items()):
        first, last = np.searchsorted(blocks.camera, (index, index + 1))
        if last > first:
            placed = camera.cam_from_rig[name] @ poses[blocks.view[first:last]]
            _fill(found, own, placed, observations, int(first))
    return found


def _fill(found: Array, camera: Camera, poses: Poses, observations: Observations, first: int) -> None:
    """The residuals of a run of blocks (B,) from index `first` on, by their poses (B,)."""
    here = slice(first, first + len(poses))
    counts, slices = observations.blocks.counts[here], observations.slices[here]
    rotations, translations = poses.rotations, poses.translations
    begin = 0
    for end in _portions(counts.tolist()):
        rows = slice(slices[begin].start, slices[end - 1].stop)
        some, xyz = counts[begin:end], observations.xyz[rows]
        r, t = rotations[begin:end], translations[begin:end]
        if some.min() == some.max():  # at once: for small views the overhead of calls would dominate
            cam = (xyz.reshape(len(some), -1, 3) @ r.transpose(0, 2, 1) + t[:, None]).reshape(-1, 3)
        else:
            cam = np.einsum("nij,nj->ni", np.repeat(r, some, 0), xyz) + np.repeat(t, some, 0)
        found[rows] = camera.project(cam) - observations.uv[rows]
        begin = end


def _portions(counts: Sequence[int]) -> Iterator[int]:
    """The ends of portions of views whose points fit into the cache."""
    points = 0
    for index, count in enumerate(counts):
        if points and points + count > POINTS_AT_A_TIME:
            yield index
            points = 0
        points += count
    if counts:
        yield len(counts)


def _check_count(kept: Observations, frees: Sequence[Array], places: int) -> None:
    if (np.bincount(kept.view, minlength=len(kept)) == 0).any():
        raise DataError("a view has no points left.", "Remove that view.")
    own = sum(f.shape[1] for f in frees) + places
    observed, unknown = 2 * kept.point_count, own + 6 * len(kept)
    if observed < unknown:
        of = "the camera" if len(frees) == 1 else "the rig"
        raise EstimationError(
            f"{observed // 2} points give {observed} coordinates for {unknown} unknowns "
            f"({own} of {of} and {6 * len(kept)} of the poses).",
            "Add points or views, hold parameters (--fix), or choose a simpler model (--model pinhole).",
        )


def _normal(problem: Problem, result: Result) -> NormalBlocks:
    """The blocks at the solution, with poses about the centroids even if the search used other coordinates."""
    if problem.normalise:
        return result.blocks.normal()
    usual = problem.normalised()
    state = usual.state(result.state.params, problem.poses(result.state), result.state.rig)
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
        samples=result.samples,
        info=result.info,
    )
