"""Undistorted pixels compared with cv2.undistortPoints."""

from __future__ import annotations

import cv2
import numpy as np

from camcal.model.camera import Camera
from camcal.model.pose import Array
from camcal.peers.base import Entry, entry, judge
from camcal.system.processes import one_opencv_thread

NAME = "cv2.undistortPoints"
#: Both invert the same equations; cv2's fixed-point iteration stops where 1e-12 of the picture plane is left, which
#: times a focal length of up to 1e4 px, and the digits it loses on the way, is below this, px.
BOUND_PX = 1e-6
#: cv2 iterates until its result no longer changes, and so often at most: strong distortion takes 50
STOP = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 500, 1e-14)


def against_cv2(stage: str, camera: Camera, uv: Array) -> Entry:
    """Pixels (N, 2) mapped to the plane z = 1 by camcal and by cv2, where both have a solution."""
    form = camera.lens.opencv(camera.params)
    if form is None or form.function != "calibrateCamera" or camera.values.get("skew", 0.0) != 0:
        return entry(stage, NAME, "not_applicable", f"cv2 has no model '{camera.lens.name}'")
    rays = camera.unproject(uv)
    ahead = rays[:, 2] > 0
    if not ahead.any():
        return entry(stage, NAME, "not_applicable", "no pixel has a ray in front of the camera")
    ours = rays[ahead, :2] / rays[ahead, 2:]
    bend = form.distortion if len(form.distortion) else None
    with one_opencv_thread():
        theirs = cv2.undistortPoints(uv[ahead].reshape(-1, 1, 2), camera.matrix, bend, None, None, None, STOP)
    worst = float(np.abs(ours - theirs.reshape(-1, 2)).max()) * float(camera.params[0])
    status, why = judge(worst, BOUND_PX, "undistorted points differ by (px)")
    return entry(stage, NAME, status, why, None, {"undistorted_max_px": worst})
