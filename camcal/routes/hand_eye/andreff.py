"""N. Andreff, R. Horaud & B. Espiau, On-line hand-eye calibration, 1999."""

from __future__ import annotations

import numpy as np

from camcal.geometry import rotations as so3
from camcal.model.pose import Pose
from camcal.routes.hand_eye.kronecker import kron, spanned
from camcal.routes.hand_eye.views import Views


def solve(views: Views) -> tuple[Pose, Pose]:
    """X and Z; eq. (11): one linear system in the nine entries of the rotation and the translation.

    (I − R_A ⊗ R_B) vec R = 0 and (I ⊗ t_Bᵀ) vec R + (I − R_A) t = t_A, with vec by rows. The matrix is replaced by
    the nearest rotation; the translation remains that of the system.
    """
    a, b = views.motions
    m = len(a)
    rows = np.zeros((m, 12, 12))
    rows[:, :9, :9] = np.eye(9) - kron(a.rotation, b.rotation)
    rows[:, 9:, :9] = kron(np.broadcast_to(np.eye(3), (m, 3, 3)), b.translation[:, None, :])
    rows[:, 9:, 9:] = np.eye(3) - a.rotation
    right = np.concatenate([np.zeros((m, 9)), a.translation], 1)
    found = np.linalg.lstsq(rows.reshape(-1, 12), right.ravel(), rcond=None)[0]
    x = Pose(so3.nearest(spanned(found[:9])), found[9:])
    return x, views.second(x)
