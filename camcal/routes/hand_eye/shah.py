"""M. Shah, Solving the robot-world/hand-eye calibration problem using the Kronecker product, 2013."""

from __future__ import annotations

import numpy as np

from camcal.geometry import rotations as so3
from camcal.model.pose import Array, Pose
from camcal.routes.hand_eye.kronecker import kron, spanned
from camcal.routes.hand_eye.views import Views


def solve(views: Views) -> tuple[Pose, Pose]:
    """X and Z; the rotations by the SVD of Σ R_C ⊗ R_G, eq. (20) to (24), then the translations, eq. (26)."""
    return views.from_rotations(*rotations_of(views.robot.rotation, views.camera.rotation))


def rotations_of(robot: Array, camera: Array) -> tuple[Array, Array]:
    """The rotations of X and Z (..., 3, 3) from those of G and C, (..., V, 3, 3), alone.

    R_X = R_G R_Z R_Cᵀ, so that vec R_X = (R_G ⊗ R_C) vec R_Z, and the sum over V views has the singular value V.
    """
    u, _, vt = np.linalg.svd(kron(robot, camera).sum(-3))
    return so3.nearest(spanned(u[..., :, 0])), so3.nearest(spanned(vt[..., 0, :]))
