"""Rotation vectors and matrices of a solution against cv2.Rodrigues, both ways."""

from __future__ import annotations

import cv2
import numpy as np

from camcal.geometry import rotations
from camcal.model.pose import Poses
from camcal.peers.base import Entry, entry, judge

NAME = "cv2.Rodrigues"
#: Rounding of a few sines, times what angles near 0 and π lose in cv2's logarithm (1e-11 at 2e-5 from them).
BOUND = 1e-9
#: Nearer to 0 or π than this, rad, cv2 takes the vector of a matrix as exactly 0 or π long.
SNAPS = 2.1e-5


def against_cv2(poses: Poses, stage: str) -> Entry:
    """The largest difference of an entry of R, and of the rotation of a rotation vector, rad.

    The second leaves out rotations by nearly 0 or π, where cv2 rounds the angle.
    """
    vectors = rotations.log(poses.rotations)
    apart = [np.abs(cv2.Rodrigues(v)[0] - r).max() for v, r in zip(vectors, poses.rotations, strict=True)]
    forth = float(np.max(apart, initial=0.0))  # NaN stays
    turned = poses.rotations[np.sin(np.linalg.norm(vectors, axis=-1)) > np.sin(SNAPS)]
    theirs = np.array([cv2.Rodrigues(np.ascontiguousarray(r))[0].ravel() for r in turned]).reshape(-1, 3)
    # compared as rotations: v and v (1 - 2π/|v|) are the same one
    back = float(rotations.angle_between(rotations.exp(theirs), turned).max(initial=0.0))
    status, why = judge(float(np.maximum(forth, back)), BOUND, "rotations differ by")
    return entry(stage, NAME, status, why, None, {"matrix_max": forth, "angle_max": back})
