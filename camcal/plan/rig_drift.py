"""Monitoring of a calibrated rig over time, with pictures of a board: whether its cameras have moved."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from camcal.assess.board_shape import separate
from camcal.assess.covariance import covariance, eliminate_poses
from camcal.assess.rig import pose_rows
from camcal.data.observations import Observations
from camcal.data.rig_table import RigViews, joined
from camcal.errors import DataError
from camcal.model.pose import Poses
from camcal.plan.known_camera import evaluate
from camcal.plan.rig_cameras import pictures_of
from camcal.plan.run import usable
from camcal.plan.solution import RigSolution
from camcal.records import dataclass
from camcal.settings.tracking import FALSE_ALARM
from camcal.solve.board_points import by_number, on_board
from camcal.solve.poses import solve_poses
from camcal.solve.problem import Problem
from camcal.solve.rig_start import corners_of, placed
from camcal.solve.turns import symmetries
from camcal.track.rig_changes import RigFollower, excess
from camcal.track.rig_equations import Instant, Picture, instant

#: px²; the variance of exact points, so that their weights stay finite
LEAST_VARIANCE = 1e-12


@dataclass(frozen=True)
class Followed:
    """A rig after the last instant.

    Attributes
    ----------
    follower : RigFollower
        With the changes and a row for each camera and instant.
    names : tuple of str
    alone : tuple of str
        Instants at which fewer than two cameras saw the board, or the pictures of no two share enough points.
    points : int
        Of boards, or matches.
    """

    follower: RigFollower
    names: tuple[str, ...]
    alone: tuple[str, ...]
    points: int


def follow(
    rig: RigSolution, views: RigViews, false_alarm: float = FALSE_ALARM, robust: str = "auto"
) -> Followed:
    """Test at each instant whether the cameras are where the rig's calibration says.

    Parameters
    ----------
    rig : RigSolution
        With its data: the uncertainty of the calibration takes part in the test.
    views : RigViews
        Of the same board, or of another one whose points are known as well.
    false_alarm : float
        Per instant.

    Raises
    ------
    DataError
        If a camera is not one of the rig's, or no instant was seen by two of them.
    """
    require_cameras(rig, views.parts)
    data, poses = _seen(rig, views, robust)
    made, alone = _instants(rig, data, poses)
    if not made:
        raise DataError(
            "no board was seen by two cameras at the same instant.",
            "Hold the board where their fields of view overlap.",
        )
    known, _ = _instants(rig, rig.observations, rig.poses)
    return tested(rig, made, known, rig.rms_point, false_alarm, alone, int(data.used.sum()))


def require_cameras(rig: RigSolution, names: Iterable[str]) -> None:
    """Raise a DataError if a camera does not belong to the rig."""
    strangers = [n for n in names if n not in rig.rig.cameras]
    if strangers:
        raise DataError(
            f"the rig has no camera '{strangers[0]}'; it has {', '.join(rig.rig.cameras)}.",
            "Name the cameras as the rig does.",
        )


def tested(
    rig: RigSolution,
    made: Sequence[Instant],
    known: Sequence[Instant],
    least_px: float,
    false_alarm: float,
    alone: tuple[str, ...],
    points: int,
) -> Followed:
    """Apply the test to the instants in order; `known` are those of the calibration, if any."""
    names = tuple(rig.rig.cameras)
    accuracy = covariance(rig).free
    follower = RigFollower(names, accuracy, *excess(made, known, accuracy), least_px, false_alarm)
    for one in made:
        follower.take(one)
    follower.finish()
    return Followed(follower, names, alone, points)


def _instants(rig: RigSolution, data: Observations, poses: Poses) -> tuple[list[Instant], tuple[str, ...]]:
    """The equations of the instants, and those at which fewer than two cameras saw the board."""
    pictures = _pictures(rig, data, poses)
    by_rig = np.array([pose_rows(rig, n) for n in rig.rig.cameras])
    places = list(rig.rig.cam_from_rig.values())
    seen = [(name, pictures.get(index, [])) for index, name in enumerate(data.view_ids)]
    made = [instant(name, there, places, by_rig) for name, there in seen if len(there) > 1]
    return made, tuple(name for name, there in seen if len(there) < 2)


def _seen(rig: RigSolution, views: RigViews, robust: str) -> tuple[Observations, Poses]:
    """The observations without outliers and with rotated boards renumbered, and rig_from_board of each instant."""
    boards = {b for own in views.boards.values() for b in own.values()}
    views = views.apart(range(max(boards, default=0) + 1))  # their relative poses are not estimated
    names = [n for n in rig.rig.cameras if n in views.parts]
    fits = {}
    for name in names:
        part = usable(views.parts[name])
        if rig.board is not None:
            part = _on_boards(part, rig)
        fits[name] = evaluate(rig.rig.cameras[name], part, robust)
    data = joined({n: f.observations for n, f in fits.items()}, views.instants, views.order)
    places = Poses.stack([rig.rig.cam_from_rig[n] for n in names])
    data, poses, _ = placed(
        pictures_of(fits, views, data), places, data, symmetries(data), corners_of(data.xyz)
    )
    return data, poses


def _on_boards(part: Observations, rig: RigSolution) -> Observations:
    """A camera's new observations, each board in its own frame and of the shape that the calibration found."""
    board, target = rig.board, rig.observations.target or {}
    assert board is not None
    if board.label is None:
        return on_board(part, board.ideal, board.points)
    if (part.target or {}).get("first_ids") != target.get("first_ids"):
        return part
    for own in separate(board, target).values():
        assert own.numbers is not None
        part = by_number(part, own.numbers, own.points)
    return part


def _pictures(rig: RigSolution, data: Observations, poses: Poses) -> dict[int, list[Picture]]:
    """The pictures of each instant, with the board's pose from each."""
    found: dict[int, list[Picture]] = {}
    names = list(rig.rig.cameras)
    row = 0
    for index, (name, camera) in enumerate(rig.rig.cameras.items()):
        free = rig.free[row : row + camera.lens.size]
        row += camera.lens.size
        if name not in data.cameras:
            continue
        kept = data.kept()
        mine = np.flatnonzero(kept.blocks.camera == data.cameras.index(name))
        views = [kept.views[b] for b in mine]
        by_view = kept.precision_by_view
        weights = None if by_view is None else [by_view[b] for b in mine]
        problem = Problem(camera.lens, views, free, weights)
        begin = rig.rig.cam_from_rig[names[index]] @ poses[kept.blocks.view[mine]]
        solved = solve_poses(problem, problem.state(camera.params, Poses.of(begin)))
        blocks = problem.linearise(solved.state)
        if blocks is None:
            raise DataError(
                f"camera '{name}': points lie outside the domain of its lens.", "Remove those views."
            )
        normal = blocks.normal()
        gain = eliminate_poses(normal).gain
        count = sum(map(len, views))
        variance = max(2 * float(solved.costs.sum()) / max(2 * count - 6 * len(views), 1), LEAST_VARIANCE)
        own = problem.poses(solved.state)
        for i, block in enumerate(mine):
            points, information = len(views[i]), normal.poses[i] / variance
            px2 = variance if weights is None else variance * points / float(weights[i].sum())
            picture = Picture(index, own[i], views[i].xyz.mean(0), information, gain[i], points, px2)
            found.setdefault(int(kept.blocks.view[block]), []).append(picture)
    return found


def moved(rig: RigSolution, found: Followed) -> RigSolution:
    """The rig with its cameras after the changes, in the frame of its reference."""
    places = {n: found.follower.place(i, rig.rig.cam_from_rig[n]) for i, n in enumerate(found.names)}
    after = type(rig.rig).in_frame_of(rig.rig.reference, rig.rig.cameras, places)
    return replace(rig, rig=after)
