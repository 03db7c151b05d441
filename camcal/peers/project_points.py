"""Projection against cv2.projectPoints, in float64: of the refined camera, and of a decomposed matrix."""

from __future__ import annotations

import cv2
import numpy as np

from camcal.data.observations import View
from camcal.geometry import projective, rotations
from camcal.model.pose import Array
from camcal.peers.base import Entry, entry, judge
from camcal.solve.calibration import Calibration

NAME = "cv2.projectPoints"
#: Rounding of a projection in float64, for pixels to 1e4 and a distance of many times the points' extent.
BOUND_PX = 1e-8
#: condition of M's left half at which it holds: a focal length of 1000 px. A wider spread costs digits in proportion
ORDINARY = 1e3


def of_solution(solution: Calibration) -> Entry | None:
    """Every point of every view by camcal's lens and by cv2; None if cv2 has no such model."""
    camera = solution.camera
    form = camera.lens.opencv(camera.params)
    if form is None or form.function != "calibrateCamera" or camera.values.get("skew", 0.0) != 0:
        return None
    worst = 0.0
    vectors = rotations.log(solution.poses.rotations)
    for view, pose, vector in zip(solution.observations.views, solution.poses, vectors, strict=True):
        ours = camera.project(pose.apply(view.xyz))
        theirs = cv2.projectPoints(
            view.xyz.reshape(-1, 1, 3),
            vector,
            pose.translation,
            camera.matrix,
            form.distortion if len(form.distortion) else None,
        )[0]
        apart = np.abs(ours - theirs.reshape(-1, 2))
        worst = max(worst, float(np.nanmax(apart, initial=0.0)))
    status, why = judge(worst, BOUND_PX, "projections differ by (px)")
    return entry("refine", NAME, status, why, None, {"projection_max_px": worst})


def of_matrix(stage: str, matrix: Array, view: View) -> Entry:
    """A projection matrix M (3, 4) against cv2's projection by its decomposition K, R, t.

    cv2 projects by R and t to the plane z = 1; K, which may hold a skew that cv2 does not have, is applied
    to that.
    """
    k, rotation, translation, mirrored = projective.decompose(matrix, view.xyz)
    if mirrored:
        return entry(stage, NAME, "not_applicable", "the world's frame is left-handed: M has no rotation")
    flat = cv2.projectPoints(
        view.xyz.reshape(-1, 1, 3), rotations.log(rotation), translation, np.eye(3), None
    )[0].reshape(-1, 2)
    theirs = projective.homogeneous(flat) @ k.T
    ours = projective.project(matrix, view.xyz)
    worst = float(np.abs(ours - theirs[:, :2]).max())
    bound = BOUND_PX * max(1.0, float(np.linalg.cond(matrix[:, :3])) / ORDINARY)
    status, why = judge(worst, bound, "projections differ by (px)")
    rms = float(np.sqrt(np.square(theirs[:, :2] - view.uv).sum(1).mean()))
    return entry(
        stage, NAME, status, why, {"rms_point": rms, "matrix": k.tolist()}, {"projection_max_px": worst}
    )
