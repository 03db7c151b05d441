"""K. Daniilidis, Hand-eye calibration using dual quaternions, 1999."""

from __future__ import annotations

import numpy as np

from camcal.errors import EstimationError
from camcal.geometry import rotations as so3
from camcal.geometry.roots import are_real
from camcal.model.pose import Array, Pose, Poses
from camcal.routes.hand_eye.views import Views


def solve(views: Views) -> tuple[Pose, Pose]:
    """X and Z; the dual quaternion q + ε q' of X is in the null space of T, eq. (31) to (35).

    Raises
    ------
    EstimationError
        If no combination of the null space is a unit dual quaternion.
    """
    a, b = views.motions
    (qa, da), (qb, db) = _dual(a), _dual(b)
    same = np.where((qa[:, :1] < 0) != (qb[:, :1] < 0), -1.0, 1.0)  # congruent screws have equal scalar parts
    qb, db = qb * same, db * same
    t = np.zeros((len(a), 6, 8))
    t[:, :3, :4] = t[:, 3:, 4:] = _difference(qa[:, 1:], qb[:, 1:])
    t[:, 3:, :4] = _difference(da[:, 1:], db[:, 1:])
    basis = np.linalg.svd(t.reshape(-1, 8), full_matrices=False)[2][-2:]
    q, dual = _unit(basis[0], basis[1])
    rotation = so3.from_quaternion(q)
    x = Pose(rotation, 2 * _product(dual, q * [1, -1, -1, -1])[1:])
    return x, views.second(x)


def _dual(poses: Poses) -> tuple[Array, Array]:
    """The unit quaternions (M, 4) of the rotations and the dual parts ½ t q, eq. (14)."""
    q = so3.quaternion(poses.rotation)
    t = np.concatenate([np.zeros((len(q), 1)), poses.translation], 1)
    return q, 0.5 * _product(t, q)


def _product(a: Array, b: Array) -> Array:
    """Products (..., 4) of quaternions, scalar first."""
    s = a[..., :1] * b[..., :1] - (a[..., 1:] * b[..., 1:]).sum(-1, keepdims=True)
    v = a[..., :1] * b[..., 1:] + b[..., :1] * a[..., 1:] + np.cross(a[..., 1:], b[..., 1:])
    return np.concatenate([s, v], -1)


def _difference(a: Array, b: Array) -> Array:
    """Blocks (a − b, [a + b]×), (M, 3, 4)."""
    return np.concatenate([(a - b)[:, :, None], so3.skew(a + b)], 2)


def _unit(v: Array, w: Array) -> tuple[Array, Array]:
    """λ1 v + λ2 w with |q| = 1 and q · q' = 0: a quadratic in λ1 / λ2, eq. (33) to (35)."""
    u1, v1, u2, v2 = v[:4], v[4:], w[:4], w[4:]
    roots = np.roots([u1 @ v1, u1 @ v2 + u2 @ v1, u2 @ v2])
    real = roots[are_real(roots)].real
    if not len(real):
        raise EstimationError("the dual quaternions of the motions have no common solution.", "Add poses.")
    lengths = [s * s * (u1 @ u1) + 2 * s * (u1 @ u2) + u2 @ u2 for s in real]
    s, length = max(zip(real, lengths, strict=True), key=lambda pair: pair[1])
    second = 1 / np.sqrt(length)
    return second * (s * u1 + u2), second * (s * v1 + v2)
