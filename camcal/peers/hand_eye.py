"""The closed forms of a hand-eye calibration against cv2.calibrateHandEye and cv2.calibrateRobotWorldHandEye."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np

from camcal.geometry import rotations
from camcal.model.pose import Array, Pose, Poses
from camcal.peers.base import Entry, entry, judge
from camcal.system.processes import one_opencv_thread

#: camcal's name -> (function of cv2, its method)
METHODS = {
    "tsai": ("calibrateHandEye", "CALIB_HAND_EYE_TSAI"),
    "park": ("calibrateHandEye", "CALIB_HAND_EYE_PARK"),
    "horaud": ("calibrateHandEye", "CALIB_HAND_EYE_HORAUD"),
    "andreff": ("calibrateHandEye", "CALIB_HAND_EYE_ANDREFF"),
    "daniilidis": ("calibrateHandEye", "CALIB_HAND_EYE_DANIILIDIS"),
    "shah": ("calibrateRobotWorldHandEye", "CALIB_ROBOT_WORLD_HAND_EYE_SHAH"),
    "li": ("calibrateRobotWorldHandEye", "CALIB_ROBOT_WORLD_HAND_EYE_LI"),
}
#: cv2 weighs the motions of these in its own way, which moves them by part of their standard deviation
WEIGHED = ("tsai", "horaud")
SIGMAS = 3.0  #: their weights move a result by a part of its standard deviation; three are more than that
#: the others solve the same systems: equal up to rounding, in standard deviations
ROUNDING = 1e-6
#: rad, and in the unit of lengths: exact data have standard deviations of 0, and rounding is so much
LEAST_SIGMA = 1e-9


def against_cv2(
    robot: Poses, camera: Poses, unit: float, ours: Mapping[str, Pose | None], sigma: tuple[float, float]
) -> list[Entry]:
    """Compare each closed form with cv2's, one entry each.

    Parameters
    ----------
    robot, camera : Poses
        G and C (V,) of G Z = X C.
    unit : float
        By which lengths are divided first, as camcal's own closed forms do.
    ours : mapping of name -> Pose
        X; None where it failed.
    sigma : (float, float)
        Standard deviations of the rotation (rad) and the translation of X, for the comparison.
    """
    return [_entry(name, robot, camera, unit, x, sigma) for name, x in ours.items()]


def _entry(
    name: str, robot: Poses, camera: Poses, unit: float, x: Pose | None, sigma: tuple[float, float]
) -> Entry:
    function, method = METHODS[name]
    against, stage = f"cv2.{function}", f"hand-eye {name}"
    if not hasattr(cv2, function):
        return entry(stage, against, "not_applicable", f"cv2 {cv2.__version__} has no {function}")
    if x is None:
        return entry(stage, against, "not_applicable", "camcal's closed form failed")
    try:
        with one_opencv_thread():
            theirs = _theirs(function, getattr(cv2, method), robot, camera, unit)
    except cv2.error as error:
        return entry(stage, against, "not_applicable", f"cv2 refuses: {error.err}")
    turn = float(rotations.angle_between(x.rotation, theirs.rotation))
    shift = float(np.linalg.norm(x.translation - theirs.translation))
    apart = max(turn / (sigma[0] + LEAST_SIGMA), shift / (sigma[1] + LEAST_SIGMA * unit))
    status, why = judge(apart, SIGMAS if name in WEIGHED else ROUNDING, "difference in standard deviations")
    difference = {"rotation_deg": float(np.degrees(turn)), "translation": shift}
    return entry(stage, against, status, why, theirs.entry(), difference)


def _theirs(function: str, method: int, robot: Poses, camera: Poses, unit: float) -> Pose:
    """X from cv2."""
    g, c = _lists(robot, unit), _lists(camera, unit)
    if function == "calibrateHandEye":
        turned: Any = robot.inverse()
        # it takes gripper2base, whose inverse is G of a camera in the hand
        r, t = getattr(cv2, function)(*_lists(turned, unit), *c, method=method)
    else:
        # A X = Z B with A = G, so that its Z is our X
        _, _, r, t = getattr(cv2, function)(*g, *c, method=method)
    return Pose(np.asarray(r), np.ravel(t) * unit)


def _lists(poses: Poses, unit: float) -> tuple[list[Array], list[Array]]:
    return list(poses.rotation), list(poses.translation / unit)
