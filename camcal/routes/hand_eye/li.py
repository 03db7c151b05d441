"""A. Li, L. Wang & D. Wu, Simultaneous robot-world and hand-eye calibration ... Kronecker product, 2010."""

from __future__ import annotations

import numpy as np

from camcal.geometry import rotations as so3
from camcal.model.pose import Pose
from camcal.routes.hand_eye.kronecker import kron, spanned
from camcal.routes.hand_eye.views import Views


def solve(views: Views) -> tuple[Pose, Pose]:
    """X and Z; one linear system in the 24 entries of both, from the section on the Kronecker product.

    (R_G ⊗ I) vec R_Z − (I ⊗ R_Cᵀ) vec R_X = 0 and R_G t_Z − t_X − (I ⊗ t_Cᵀ) vec R_X = −t_G, with vec by rows. The
    matrices are replaced by the nearest rotations; the translations remain those of the system.
    """
    g, c = views.robot, views.camera
    v = len(views)
    eye = np.broadcast_to(np.eye(3), (v, 3, 3))
    rows = np.zeros((v, 12, 24))  # vec R_X, vec R_Z, t_X, t_Z
    rows[:, :9, :9] = -kron(eye, np.swapaxes(c.rotation, 1, 2))
    rows[:, :9, 9:18] = kron(g.rotation, eye)
    rows[:, 9:, :9] = -kron(eye, c.translation[:, None, :])
    rows[:, 9:, 18:21] = -eye
    rows[:, 9:, 21:] = g.rotation
    right = np.concatenate([np.zeros((v, 9)), -g.translation], 1)
    found = np.linalg.lstsq(rows.reshape(-1, 24), right.ravel(), rcond=None)[0]
    x, z = (so3.nearest(spanned(found[at : at + 9])) for at in (0, 9))
    return Pose(x, found[18:21]), Pose(z, found[21:])
