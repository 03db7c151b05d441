"""From a calibration and a robot's poses to the hand-eye transformation and its warnings."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from camcal.assess.covariance import covariance
from camcal.assess.warning import CalibrationWarning
from camcal.data.robot_poses import RobotPoses, Stream, matched
from camcal.errors import DataError, UsageError
from camcal.model.pose import Pose, Poses
from camcal.plan.solution import RigSolution, Solution
from camcal.records import dataclass
from camcal.routes.hand_eye import closed_forms, offset, recognise
from camcal.routes.hand_eye.estimate import Estimate, estimate
from camcal.routes.hand_eye.motions import Motions, measure, require_enough, require_two_axes
from camcal.routes.hand_eye.next_pose import Suggestion, suggest
from camcal.routes.hand_eye.pictures import Mount, Pictures, alone
from camcal.routes.hand_eye.recognise import Reading
from camcal.routes.hand_eye.remarks import remarks
from camcal.routes.hand_eye.scale import MILLIMETRES, require_same_unit, scale
from camcal.routes.hand_eye.views import Views, views_of
from camcal.solve.problem import Seen

#: Names of pictures are stamps in seconds, ms, us, ns since 1970 from these values up (2001 to 2286); smaller whole
#: numbers count pictures.
STAMPS = ((1e18, 1e9), (1e15, 1e6), (1e12, 1e3), (1e9, 1.0))


@dataclass(frozen=True)
class Asked:
    """The arguments of `camcal hand-eye` and `camcal.hand_eye`; see the options of the command."""

    setup: str | None = None
    inverse: bool = False
    poses_unit: str | None = None
    times: Mapping[str, float] | None = None
    max_offset: float = 1.0
    robust: str = "auto"
    crosscheck: bool = True


@dataclass(frozen=True)
class Found:
    """The result.

    Attributes
    ----------
    estimate : Estimate
    reading : Reading
        The set-up and the form of the rotations that were taken.
    names : tuple of str
        Of the views with a pose, outliers included; `estimate.used` indexes them.
    scale, scale_sigma : float
        Length of the robot's motions over what the board says.
    camera : mapping of parameter -> (value, sigma, value before, sigma before)
        Of a single camera that was calibrated from the same pictures, with the robot's poses; empty of others.
    suggestions : list of Suggestion
    warnings : tuple of CalibrationWarning
    crosscheck : list of entries of the report
    """

    estimate: Estimate
    reading: Reading
    names: tuple[str, ...]
    scale: float
    scale_sigma: float
    camera: Mapping[str, tuple[float, float, float, float]]
    suggestions: list[Suggestion]
    warnings: tuple[CalibrationWarning, ...]
    crosscheck: list[dict[str, Any]]


def find(solution: Solution | RigSolution, robot: RobotPoses, asked: Asked) -> Found:
    """Run a hand-eye calibration.

    Parameters
    ----------
    solution : Solution or RigSolution
        A calibration, or a known camera evaluated, of pictures of a board that stood still (or that the hand held). Of
        a rig, the camera is its reference.
    robot : RobotPoses
    asked : Asked

    Raises
    ------
    DataError
        Views without poses, fewer than three, lengths in another unit.
    UsageError
        If the set-up has to be said.
    EstimationError
        Motions that do not determine the transformation, poses that do not belong to the views.
    """
    unit = _unit(solution)
    robot = _in_unit(robot, asked.poses_unit, unit)
    pictures, ids = _pictures(solution)
    if robot.names is None:
        return _of_stream(pictures, ids, robot, asked, solution)
    rows, places = matched(robot, ids)
    if not rows:
        raise DataError(
            f"no view of '{robot.path}' ({robot.names[0]}, ...) is one of the pictures ({ids[0]}, ...).",
            "Use the names of the pictures as view names, with or without folder and extension.",
        )
    require_enough(len(rows))
    lost = (len(ids) - len(rows), len(robot) - len(rows))
    robot, pictures = robot.take(rows), pictures.take(np.array(places))
    names = tuple(ids[i] for i in places)
    require_two_axes(_turns(pictures), asked.setup)
    found = recognise.readings(robot, pictures.poses, recognise.SETUPS, asked.inverse)
    reading = recognise.choose(found, robot, asked.setup, len(rows))
    poses = robot.poses(reading.form, asked.inverse)
    size = scale(views_of(reading.setup, poses, pictures.poses))
    other = recognise.better_reading(found, reading, len(rows))
    require_same_unit(size[0], unit, other)
    made = estimate(reading.setup, pictures, poses, asked.robust != "none")
    return _told(made, reading, other, names, size, lost, asked, solution)


def _of_stream(
    pictures: Pictures,
    ids: tuple[str, ...],
    robot: RobotPoses,
    asked: Asked,
    solution: Solution | RigSolution,
) -> Found:
    """The calibration with poses that have times instead of views."""
    assert robot.times is not None
    if len(robot) < 2:
        raise DataError(
            f"'{robot.path}' holds {len(robot)} pose; poses with times need to be 2 or more.", "Add poses."
        )
    times = np.array([_time(v, asked.times) for v in ids])
    require_enough(len(ids))
    factor = next((f for bound, f in STAMPS if robot.times[0] >= bound), 1.0)
    if asked.setup is None:
        raise UsageError(
            "poses with times require the set-up, which was not given.",
            "Add --setup in-hand or --setup to-hand.",
        )
    require_two_axes(_turns(pictures), asked.setup)
    stream = Stream(robot.times / factor, robot.poses(None, asked.inverse))
    begin = offset.search(asked.setup, stream, times, pictures.poses, asked.max_offset)
    at = offset.robot_at(stream, times)
    views = views_of(asked.setup, at(begin).poses, pictures.poses)
    reading = Reading(asked.setup, robot.form, *recognise.misfits(views))
    reading = recognise.choose([reading], replace(robot, certain=True), asked.setup, len(ids))
    size = scale(views)
    require_same_unit(size[0], (solution.observations.target or {}).get("unit"))
    made = estimate(asked.setup, pictures, at, asked.robust != "none", begin)
    return _told(made, reading, None, ids, size, (0, 0), asked, solution)


def _told(
    made: Estimate,
    reading: Reading,
    other: Reading | None,
    names: tuple[str, ...],
    size: tuple[float, float],
    lost: tuple[int, int],
    asked: Asked,
    solution: Solution | RigSolution,
) -> Found:
    target = solution.observations.target or {}
    side = target.get("square")
    square = None if side is None else f"{side * size[0]:.3g} {target.get('unit', '')}".strip()
    suggestions = suggest(made)
    views = views_of(made.setup, made.measured, made.poses)
    checks = _crosscheck(made, views) if asked.crosscheck else []
    said = tuple(remarks(made, reading, other, names, size, lost, square))
    camera = camera_along(made, solution) if isinstance(solution, Solution) else {}
    return Found(made, reading, names, *size, camera, suggestions, said, checks)


def camera_along(made: Estimate, solution: Solution) -> dict[str, tuple[float, float, float, float]]:
    """The parameters of a camera with the robot's poses, and by the pictures alone; see `Found.camera`."""
    count = len(made.camera)
    if not count:
        return {}
    root = solution.free @ made.pictures.camera_root
    camera, left = solution.camera, made.shared[-count:, -count:]
    sigmas = np.sqrt(np.maximum(np.einsum("pi,ij,pj->p", root, left, root), 0.0))
    before = np.sqrt(np.square(root).sum(1))
    columns = (camera.params + root @ made.camera, sigmas, camera.params, before)
    return dict(zip(camera.lens.names, zip(*(c.tolist() for c in columns), strict=True), strict=True))


def _crosscheck(made: Estimate, views: Views) -> list[dict[str, Any]]:
    from camcal.peers.hand_eye import against_cv2  # cv2 is loaded only here

    ours: dict[str, Pose | None] = {m.name: m.x for m in closed_forms.solve_all(views, made.setup)}
    sigma = made.sigma
    sizes = float(np.linalg.norm(sigma[:3])), float(np.linalg.norm(sigma[3:6]))
    return against_cv2(views.robot, views.camera, closed_forms.length_unit(views), ours, sizes)


def _pictures(solution: Solution | RigSolution) -> tuple[Pictures, tuple[str, ...]]:
    """The points used by the calibration, and the names of their instants."""
    used = solution.observations.kept()
    weights = used.precision_by_view
    accuracy = covariance(solution)
    place = {name: i for i, name in enumerate(solution.observations.view_ids)}
    kept = np.array([place[n] for n in used.view_ids], int)
    known, gain = accuracy.free, accuracy.poses_reduced.gain[kept]
    if not np.isfinite(known).all():
        known, gain = np.zeros((0, 0)), np.zeros((len(kept), 6, 0))
    poses: Poses = solution.poses[kept]
    given = (tuple(used.views), poses, weights, gain, known)
    if isinstance(solution, Solution):
        return Pictures(solution.camera, *given), used.view_ids
    rig = solution.rig
    seen = Seen(used.blocks.camera, used.blocks.view)
    mount = Mount(solution.cameras, Poses.stack(list(rig.cam_from_rig.values())), seen)
    return Pictures(rig.cameras[rig.reference], *given, mount), used.view_ids


def _turns(pictures: Pictures) -> Motions:
    seen = alone(pictures)
    return measure(seen.poses, seen.rotation_covariance)


def _unit(solution: Solution | RigSolution) -> str | None:
    """The unit of the board's lengths; None if the points do not have one.

    Raises
    ------
    UsageError
        If lengths are in squares.
    """
    target = solution.observations.target or {}
    unit = target.get("unit")
    if unit == "square":
        raise UsageError(
            "the board's lengths are in squares; a hand-eye calibration needs the side of a square.",
            "Give it, such as --square 25mm, where the pictures are read.",
        )
    return None if unit is None else str(unit)


def _in_unit(robot: RobotPoses, given: str | None, unit: str | None) -> RobotPoses:
    if given is None:
        return robot
    if unit not in MILLIMETRES:
        raise UsageError(
            f"the poses are in {given}, but the unit of the pictures' lengths is not known.",
            "Omit --poses-unit, and give both in the same unit.",
        )
    return robot.scaled(MILLIMETRES[given] / MILLIMETRES[unit])


def _time(name: str, times: Mapping[str, float] | None) -> float:
    """The time of a view, s: from the table, or from a name that is a time stamp."""
    if times is not None:
        short = name.replace("\\", "/").rpartition("/")[2]
        if name not in times and short not in times:
            raise DataError(f"--times has no time of the view '{name}'.", "Add it, or remove the view.")
        return times[name] if name in times else times[short]
    stem = re.sub(r"\.[A-Za-z]\w*$", "", name.replace("\\", "/").rpartition("/")[2])
    if re.fullmatch(r"\d+(\.\d+)?", stem):
        value = float(stem)
        factor = next((f for bound, f in STAMPS if value >= bound), None)
        if factor is not None or "." in stem:
            return value / (factor or 1.0)
    raise UsageError(
        f"the poses have times, but the view '{name}' has none.", "Give --times FILE, a table view,time."
    )
