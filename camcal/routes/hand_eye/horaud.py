"""R. Horaud & F. Dornaika, Hand-eye calibration, 1995: the closed form of its rotation."""

from __future__ import annotations

import numpy as np

from camcal.geometry import rotations as so3
from camcal.model.pose import Array, Pose
from camcal.routes.hand_eye.views import Views

#: rad; the axis of a smaller rotation is rounding error
SMALLEST_TURN = 1e-9


def solve(views: Views) -> tuple[Pose, Pose]:
    """X and Z; the quaternion of X minimises Σ |n_A q − q n_B|² over the unit axes n, sec. 4.1, eq. (23)."""
    a, b = views.motions
    na, nb, known = _axes(a.rotation, b.rotation)
    q = _left(na) - _right(nb)
    normal = np.einsum("m,mki,mkj->ij", known, q, q)
    return views.from_rotation(so3.from_quaternion(np.linalg.eigh(normal)[1][:, 0]))


def _axes(a: Array, b: Array) -> tuple[Array, Array, Array]:
    va, vb = so3.log(a), so3.log(b)
    la, lb = (np.linalg.norm(v, axis=1, keepdims=True) for v in (va, vb))
    known = (np.minimum(la, lb) > SMALLEST_TURN)[:, 0]
    return va / np.where(la > 0, la, 1.0), vb / np.where(lb > 0, lb, 1.0), known.astype(float)


def _left(v: Array) -> Array:
    """Matrices (M, 4, 4) with (0, v) q = _left(v) q."""
    out = np.zeros((len(v), 4, 4))
    out[:, 0, 1:], out[:, 1:, 0], out[:, 1:, 1:] = -v, v, so3.skew(v)
    return out


def _right(v: Array) -> Array:
    """Matrices (M, 4, 4) with q (0, v) = _right(v) q."""
    out = np.zeros((len(v), 4, 4))
    out[:, 0, 1:], out[:, 1:, 0], out[:, 1:, 1:] = -v, v, -so3.skew(v)
    return out
