"""R. Tsai & R. Lenz, A new technique for fully autonomous and efficient 3D robotics hand/eye calibration, 1989."""

from __future__ import annotations

import numpy as np

from camcal.geometry import rotations as so3
from camcal.model.pose import Array, Pose
from camcal.routes.hand_eye.views import Views


def solve(views: Views) -> tuple[Pose, Pose]:
    """X and Z; eq. (10) to (15) of the paper.

    With P = 2 sin(θ/2) n of each motion, [P_A + P_B]× P' = P_B − P_A and P_X = 2 P' / √(1 + |P'|²). Undefined if X
    rotates by 180°.
    """
    a, b = views.motions
    pa, pb = _modified_rodrigues(a.rotation), _modified_rodrigues(b.rotation)
    left, right = so3.skew(pa + pb).reshape(-1, 3), (pb - pa).ravel()
    p = np.linalg.lstsq(left, right, rcond=None)[0]
    # P' = tan(θ/2) n: the same rotation as a quaternion (1, P')
    return views.from_rotation(so3.from_quaternion(np.r_[1.0, p]))


def _modified_rodrigues(rotation: Array) -> Array:
    q = so3.quaternion(rotation)
    return 2 * q[..., 1:] * np.where(q[..., :1] < 0, -1.0, 1.0)
