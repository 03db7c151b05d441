"""Triangulated points compared with cv2.triangulatePoints, which is linear and takes two cameras."""

from __future__ import annotations

import cv2
import numpy as np

from camcal.geometry.projective import FLAT_RAY
from camcal.model.camera import Camera
from camcal.model.pose import Array, Pose
from camcal.peers.base import LOWER_PX, SAME, Entry, entry, judge
from camcal.system.processes import one_opencv_thread

STAGE, NAME = "triangulate", "cv2.triangulatePoints"

Seen = tuple[Camera, Pose, Array]  #: camera, cam_from_world, uv (N, 2)


def against_cv2(first: Seen, second: Seen, xyz: Array) -> Entry:
    """Least-squares points (N, 3) of two cameras against cv2's, by their rms_point over both.

    Least squares may not fit worse than the linear solution; how far both lie apart is reported.
    """
    rays = [camera.unproject(uv) for camera, _, uv in (first, second)]
    good = np.logical_and.reduce([r[:, 2] > FLAT_RAY for r in rays]) & np.isfinite(xyz).all(1)
    if not good.any():
        return entry(STAGE, NAME, "not_applicable", "no point is seen well in front of two cameras")
    matrices = [np.c_[pose.rotation, pose.translation] for _, pose, _ in (first, second)]
    flat = [np.ascontiguousarray((r[good, :2] / r[good, 2:]).T) for r in rays]
    with one_opencv_thread():
        found = cv2.triangulatePoints(*matrices, *flat)
    theirs = (found[:3] / found[3]).T
    residuals = [_errors((c, p, uv[good]), theirs, xyz[good]) for c, p, uv in (first, second)]
    both = np.isfinite([r for pair in residuals for r in pair]).all(0)
    if not both.any():
        return entry(STAGE, NAME, "not_applicable", "cv2's points lie behind the cameras")
    squares = np.square([[r[both] for r in pair] for pair in residuals]).sum(0).mean(1) / 2
    ours_rms, theirs_rms = np.sqrt(squares[1]), np.sqrt(squares[0])
    status, why = judge(float(ours_rms), float(theirs_rms) * (1 + SAME) + LOWER_PX, "rms_point (px)")
    apart = np.linalg.norm(theirs[both] - xyz[good][both], axis=1)
    return entry(
        STAGE,
        NAME,
        status,
        why,
        {"rms_point": float(theirs_rms), "points": int(both.sum())},
        {"rms_point": float(ours_rms - theirs_rms), "median_distance": float(np.median(apart))},
    )


def _errors(seen: Seen, theirs: Array, ours: Array) -> tuple[Array, Array]:
    """Distances (N,) in px from the observed points, of cv2's points and of camcal's."""
    camera, pose, uv = seen
    first, second = (np.linalg.norm(camera.project(pose.apply(x)) - uv, axis=1) for x in (theirs, ours))
    return first, second
