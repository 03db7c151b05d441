"""cv2.calibrateCameraRO: the board's points estimated together with the camera (`--board-shape free`).

Strobl & Hirzinger 2011. cv2 holds the first point, a second one and the height of the last, each at its ideal
place; camcal holds two points and the height of a third, too (`camcal.solve.board`), and any such choice
describes the same board up to its frame and size. cv2 gets the points in an order that makes the choices
one. It takes only views that show all points, without weights, and needs time that grows with the cube of the
number of unknowns.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from camcal.data.observations import Observations, View
from camcal.errors import CamcalError
from camcal.geometry import rotations
from camcal.model.camera import Camera
from camcal.model.pose import Array, Poses
from camcal.peers import refinement
from camcal.peers.base import LEAST_POINTS, Entry, NotComparableError, Result, Task, entry
from camcal.peers.calibrate_camera import answer, begin, camera_of, criteria, refusals, rms_of, where
from camcal.solve.board import gauge_points, settle
from camcal.solve.board_points import on_board
from camcal.solve.calibration import Calibration
from camcal.solve.common_points import common_points
from camcal.solve.refine import How

NAME = "cv2.calibrateCameraRO"
#: Unknowns (three a point, six a view) up to which cv2 is asked: 2 s for 240, 55 s for 500.
MOST_UNKNOWNS = 400
#: ... where it begins at the result, unless the full comparison is requested: .15 s for 240, .7 s for 400.
QUICK_UNKNOWNS = 300
#: Part of the observations that has to be left once all views hold the same points.
LEAST_SHARE = 0.5


def against_cv2(solution: Calibration, how: How | None = None, full: bool = True) -> Entry | None:
    """Compare a solution with a free board; None if the board is not free or cv2 lacks the lens model.

    Where it has weights, skew, or views without some of the points, what cv2 can solve is fitted again; `how` is how
    the solution was made. cv2 begins at the board as designed, or, where it is not `full`, at the result.
    """
    board = solution.board
    form = solution.camera.lens.opencv(solution.camera.params)
    if board is None or board.kind != "free":
        return None
    if board.label is not None:
        return entry(refinement.STAGE, NAME, "not_applicable", "it estimates the shape of one board")
    if form is None or form.function != "calibrateCamera":
        return None
    try:
        data = complete(refinement.unweighted(solution))
        _check_size(data, full)
        missing, _, skew = refinement.unlike(solution)
        if not missing and data.point_count == solution.observations.point_count:
            return refinement.compare(solution, NAME, "", run, full)
        flat = on_board(data, board.points, board.ideal)
        again = refinement.fitted_again(solution, flat, replace(how or How(), board="free"))
    except (NotComparableError, CamcalError) as error:
        return entry(refinement.STAGE, NAME, "not_applicable", str(error))
    remark = (
        f"over the {len(data.views[0])} points that {len(data.views)} views share, with unit weights in both"
    )
    return refinement.compare(again, NAME, remark + (" and without skew" if skew else ""), run, full)


def complete(data: Observations) -> Observations:
    """The part of the data in which each view shows the same points, in the same order.

    Either the points that all views show, or the views that show all points, whichever is more.

    Raises
    ------
    NotComparableError
        If little is left.
    """
    common = common_points(data.views)
    assert common is not None  # a board was estimated from them
    points, ids = common
    counts = np.bincount(np.concatenate(ids), minlength=len(points))
    shared = counts == len(data.views)
    full = [len(i) == len(points) for i in ids]
    if shared.sum() * len(data.views) >= sum(full) * len(points):
        full = [True] * len(data.views)
    else:
        shared = np.ones(len(points), bool)
    chosen = [_sorted(view, at, shared) for view, at, keep in zip(data.views, ids, full, strict=True) if keep]
    if sum(len(v) for v in chosen) < LEAST_SHARE * data.point_count or shared.sum() < LEAST_POINTS:
        raise NotComparableError("cv2 needs all points in every view, and too few views have them")
    return data.with_views(chosen)


def _sorted(view: View, ids: Array, shared: Array) -> View:
    order = np.argsort(ids)
    return view.take(order[shared[ids[order]]])


def _check_size(data: Observations, full: bool) -> None:
    unknowns = 3 * len(data.views[0]) + 6 * len(data.views)
    if unknowns > MOST_UNKNOWNS:
        raise NotComparableError(
            f"cv2 would take minutes for {unknowns} unknowns; up to {MOST_UNKNOWNS} are compared"
        )
    if unknowns > QUICK_UNKNOWNS and not full:
        raise NotComparableError(
            f"cv2 takes seconds for {unknowns} unknowns; use --crosscheck full to wait for it"
        )


def run(task: Task, guess: Camera | None) -> Result:
    """Run cv2.calibrateCameraRO on a solution whose views all show the whole board.

    Raises
    ------
    NotComparableError
        If cv2 cannot estimate the same parameters, or refuses the data.
    """
    solution = task.solution
    board = solution.board
    assert board is not None
    data = complete(solution.observations)
    ideal = on_board(data, board.points, board.ideal).views[0].xyz
    order = _gauge_order(ideal)
    seen = [v.uv[order] for v in data.views]
    xyz = ideal[order] - ideal[order[0]]
    flat = replace(task, views=tuple((xyz, uv) for uv in seen))
    guess, flags, matrix, distortion = begin(flat, guess)
    if (
        guess is not None
    ):  # cv2 5.0 then takes its normal equations for a problem without free points, and refuses it
        flags |= getattr(cv2, "CALIB_DISABLE_SCHUR_COMPLEMENT", 0)
    if guess is solution.camera:
        xyz = data.views[0].xyz[order] - data.views[0].xyz[order[0]]
    with refusals():
        _, *returned = cv2.calibrateCameraRO(
            [xyz.astype(np.float32).reshape(-1, 1, 3)] * len(seen),
            [uv.astype(np.float32).reshape(-1, 1, 2) for uv in seen],
            task.image_size,
            1,
            matrix,
            distortion,
            flags=flags,
            criteria=criteria(task.iterations),
        )
    k, bend, rvecs, tvecs = answer(returned)
    found = np.array(returned[4], float).reshape(-1, 3)
    points, poses, _ = settle(found, ideal[order], Poses(rotations.exp(rvecs), tvecs))
    placed = np.empty_like(board.points)
    placed[_rows(board.ideal, ideal[order])] = points
    return Result(
        camera_of(solution.camera, k, bend),
        poses,
        rms_of([(found, uv) for uv in seen], k, bend, rvecs, tvecs),
        bend,
        where(guess, solution),
        placed,
    )


def _gauge_order(points: Array) -> Array:
    """An order (M,) that starts with two points far apart and ends with one far from their line."""
    a, b, c = gauge_points(points)
    return np.array([a, b, *(i for i in range(len(points)) if i not in (a, b, c)), c])


def _rows(points: Array, some: Array) -> Array:
    """The index of each of some points (M, 3) among the points (M, 3)."""
    return np.array([int(np.linalg.norm(points - p, axis=1).argmin()) for p in some])
