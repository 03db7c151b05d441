"""Fundamental matrices against cv2.findFundamentalMat, relative poses against cv2.findEssentialMat and recoverPose."""

from __future__ import annotations

import cv2
import numpy as np

from camcal.geometry import rotations
from camcal.geometry.projective import FLAT_RAY
from camcal.model.camera import Camera
from camcal.model.pose import Array, Pose
from camcal.peers.base import Entry, entry, judge
from camcal.system.processes import one_opencv_thread

STAGE = "selfcalib"
#: camcal's Sampson rms may exceed cv2's by this part: both minimise it only approximately
WORSE = 0.05
#: px; ... and by this much where the matches are exact
EXACT = 1e-6
#: degrees; the motion between two views of a bundle and that of their matches alone: a pair by itself is weaker than
#: all views together
TURN = 2.0


def fundamental(first: Array, second: Array, matrix: Array) -> Entry:
    """Sampson rms (px) of F over the matches (N, 2) that agree with it, against cv2's eight-point matrix of the
    same.
    """
    name = "cv2.findFundamentalMat"
    with one_opencv_thread():
        theirs, _ = cv2.findFundamentalMat(first, second, cv2.FM_8POINT)
    if theirs is None or theirs.shape != (3, 3):
        return entry(STAGE, name, "not_applicable", "cv2 finds none")
    ours_rms, theirs_rms = (_sampson_rms(f, first, second) for f in (matrix, theirs))
    status, why = judge(ours_rms, theirs_rms * (1 + WORSE) + EXACT, "Sampson rms (px)")
    return entry(STAGE, name, status, why, {"rms": theirs_rms}, {"rms": ours_rms - theirs_rms})


def motion(camera: Camera, first: Array, second: Array, ours: Pose) -> Entry:
    """The rotation between two views of a bundle against cv2's from their matches, with the same camera."""
    name = "cv2.findEssentialMat"
    rays = [camera.unproject(uv) for uv in (first, second)]
    if any((r[:, 2] < FLAT_RAY).any() for r in rays):
        return entry(
            STAGE, name, "not_applicable", "cv2 accepts only rays less than 90 degrees from the axis"
        )
    a, b = (np.ascontiguousarray(r[:, :2] / r[:, 2:]) for r in rays)
    with one_opencv_thread():
        e, mask = cv2.findEssentialMat(a, b, np.eye(3), cv2.LMEDS)
        if e is None or e.shape != (3, 3):
            return entry(STAGE, name, "not_applicable", "cv2 finds none")
        _, r, t, _ = cv2.recoverPose(e, a, b, np.eye(3), mask=mask)
    turn = float(np.degrees(rotations.angle_between(ours.rotation, r)))
    status, why = judge(turn, TURN, "rotations differ by (degrees)")
    theirs = {"rotation_vector": rotations.log(r).tolist(), "direction": t.ravel().tolist()}
    return entry(STAGE, name, status, why, theirs, {"rotation_deg": turn})


def _sampson_rms(f: Array, first: Array, second: Array) -> float:
    a, b = (np.c_[uv, np.ones(len(uv))] for uv in (first, second))
    fa, fb = a @ f.T, b @ f
    value = (b * fa).sum(1) / np.sqrt(np.square(fa[:, :2]).sum(1) + np.square(fb[:, :2]).sum(1))
    return float(np.sqrt((value**2).mean()))
