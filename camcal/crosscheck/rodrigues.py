"""Rotation vectors and matrices of a solution against cv2.Rodrigues, both ways."""

from __future__ import annotations

import cv2
import numpy as np

from camcal.crosscheck.base import Entry, entry, judge
from camcal.geometry import rotations
from camcal.types import Poses

NAME = "cv2.Rodrigues"
#: Rounding of a few sines, times what angles near π lose in cv2's logarithm (it goes by the matrix's trace).
BOUND = 1e-9


def against_cv2(poses: Poses, stage: str) -> Entry:
    """The largest difference of an entry of R, and of the rotation that a vector means, rad."""
    vectors = rotations.log(poses.rotations)
    forth = max(
        (float(np.abs(cv2.Rodrigues(v)[0] - r).max()) for v, r in zip(vectors, poses.rotations, strict=True)),
        default=0.0,
    )
    theirs = np.array([cv2.Rodrigues(np.ascontiguousarray(r))[0].ravel() for r in poses.rotations])
    # compared as rotations: v and v (1 - 2π/|v|) are the same one
    back = float(
        rotations.angle_between(rotations.exp(theirs.reshape(-1, 3)), poses.rotations).max(initial=0.0)
    )
    status, why = judge(max(forth, back), BOUND, "rotations differ by")
    return entry(stage, NAME, status, why, None, {"matrix_max": forth, "angle_max": back})
