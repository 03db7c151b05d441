"""Rotations: exponential and logarithm, Euler angles, and the fit of a rotation to point pairs.

Rotation matrices are (..., 3, 3), rotation vectors (..., 3) in radians; a perturbation acts on the left,
exp(δ) R.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray

_IDENTITY = np.eye(3)


def skew(v: Array) -> Array:
    """Matrices (..., 3, 3) with skew(v) @ w = v x w, for vectors (..., 3)."""
    v = np.asarray(v, float)
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2] = -v[..., 2], v[..., 1]
    out[..., 1, 0], out[..., 1, 2] = v[..., 2], -v[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -v[..., 1], v[..., 0]
    return out


def exp(vector: Array) -> Array:
    """Rotation matrices of rotation vectors (Rodrigues' formula); the sine's own series keeps all digits near zero.

    Parameters
    ----------
    vector : (..., 3) array, rad

    Returns
    -------
    (..., 3, 3) array
    """
    vector = np.asarray(vector, float)
    # below that length sin t / t is 1 and its square does not underflow
    t = np.maximum(np.sqrt(np.einsum("...i,...i->...", vector, vector)), 1e-100)[..., None, None]
    k = skew(vector)
    found = (np.sin(t) / t) * k
    found += 2 * (np.sin(0.5 * t) / t) ** 2 * (k @ k)
    found += _IDENTITY
    return found


def left_jacobian(vector: Array) -> Array:
    """Matrices (..., 3, 3) with exp(v + dv) = exp(J(v) dv) exp(v) to first order, for vectors (..., 3).

    J = I + (1 - cos t)/t² [v] + (t - sin t)/t³ [v]² with t = |v| (T. Barfoot, State Estimation for Robotics,
    eq. 7.77b).
    """
    vector = np.asarray(vector, float)
    t2 = np.einsum("...i,...i->...", vector, vector)
    t = np.sqrt(t2)
    small = t2 < 1e-4  # the next terms, t⁶ / 40320 and t⁶ / 362880, are below rounding (1e-16)
    safe = np.where(small, 1.0, t)
    a = np.where(small, 0.5 - t2 / 24 + t2**2 / 720, 2 * (np.sin(safe / 2) / safe) ** 2)
    b = np.where(small, 1 / 6 - t2 / 120 + t2**2 / 5040, (safe - np.sin(safe)) / safe**3)
    k = skew(vector)
    return np.eye(3) + a[..., None, None] * k + b[..., None, None] * (k @ k)


def log(rotation: Array) -> Array:
    """Rotation vectors (..., 3) of rotation matrices (..., 3, 3), of length 0 to π.

    Goes by the unit quaternion, whose largest component is taken first, so that angles near 0 and
    near π keep their digits.
    """
    q = quaternion(rotation)
    q = q * np.where(q[..., :1] < 0, -1.0, 1.0)
    n = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    angle = 2 * np.arctan2(n, q[..., :1])
    small = n < 1e-9  # angle / n = 2 (1 + n² / 6 ...) there, whose second term is below rounding (1e-16)
    factor = np.where(small, 2.0, angle / np.where(small, 1.0, n))
    return factor * q[..., 1:]


def quaternion(rotation: Array) -> Array:
    """Unit quaternions (..., 4), scalar first, of rotation matrices (Shepperd 1978)."""
    r = np.asarray(rotation, float)
    d = np.einsum("...ii->...i", r)
    trace = d.sum(-1)
    weights = np.concatenate([trace[..., None], d], -1)
    best = weights.argmax(-1)[..., None, None]
    # the four rows of 4 q qᵀ; the one with the largest diagonal is divided by its root
    x, y, z = (r[..., 2, 1] - r[..., 1, 2], r[..., 0, 2] - r[..., 2, 0], r[..., 1, 0] - r[..., 0, 1])
    xy, xz, yz = (r[..., 1, 0] + r[..., 0, 1], r[..., 2, 0] + r[..., 0, 2], r[..., 2, 1] + r[..., 1, 2])
    d0, d1, d2 = d[..., 0], d[..., 1], d[..., 2]
    rows = np.stack(
        [
            np.stack([1 + trace, x, y, z], -1),
            np.stack([x, 1 + d0 - d1 - d2, xy, xz], -1),
            np.stack([y, xy, 1 - d0 + d1 - d2, yz], -1),
            np.stack([z, xz, yz, 1 - d0 - d1 + d2], -1),
        ],
        -2,
    )
    q = np.take_along_axis(rows, np.broadcast_to(best, (*rows.shape[:-2], 1, 4)), -2)[..., 0, :]
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def from_quaternion(q: Array) -> Array:
    """Rotation matrices (..., 3, 3) of quaternions (..., 4), scalar first, of any length but zero."""
    q = np.asarray(q, float)
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    k = skew(q[..., 1:])
    return np.eye(3) + 2 * (q[..., :1, None] * k + k @ k)


def nearest(matrix: Array) -> Array:
    """The rotations (..., 3, 3) nearest to any matrices in the Frobenius norm (SVD, determinant +1)."""
    u, _, vt = np.linalg.svd(matrix)
    u = u.copy()
    u[..., :, 2] *= np.linalg.det(u @ vt)[..., None]
    return u @ vt


def angle_between(a: Array, b: Array) -> Array:
    """Angles (...) in radians of the rotations that take b to a."""
    return np.linalg.norm(log(a @ np.swapaxes(b, -1, -2)), axis=-1)


def fit_rotation(a: Array, b: Array, weights: Array | None = None) -> Array:
    """The rotation R that minimises Σ w |a - R b|² (Wahba's problem, Kabsch's SVD solution).

    Parameters
    ----------
    a, b : (N, 3) arrays
    weights : (N,) array, optional
    """
    w = np.ones(len(a)) if weights is None else weights
    return nearest((a * w[:, None]).T @ b)


def from_euler(alpha: float, beta: float, theta: float) -> Array:
    """R = Rz(theta) Ry(beta) Rx(alpha), the order of Barranco & Medel, section 5.1; radians."""
    ca, sa, cb, sb, ct, st = (f(x) for x in (alpha, beta, theta) for f in (np.cos, np.sin))
    rx = np.array([[1, 0, 0], [0, ca, -sa], [0, sa, ca]])
    ry = np.array([[cb, 0, sb], [0, 1, 0], [-sb, 0, cb]])
    rz = np.array([[ct, -st, 0], [st, ct, 0], [0, 0, 1]])
    return rz @ ry @ rx


def to_euler(rotation: Array) -> tuple[float, float, float]:
    """The angles (alpha, beta, theta) of `from_euler`, rad; beta in [-π/2, π/2].

    At beta = ±π/2 only the difference or the sum of the others is determined; theta is then 0. Near there
    alpha is taken from what the other two leave of the matrix, so that `from_euler` gives it back.
    """
    r = np.asarray(rotation, float)
    cos_beta = np.hypot(r[0, 0], r[1, 0])
    # 4 eps: what rounding leaves of the two entries of a product of three rotations at beta = ±π/2
    theta = np.arctan2(r[1, 0], r[0, 0]) if cos_beta > 4 * np.finfo(float).eps else 0.0
    c, s = np.cos(theta), np.sin(theta)
    # the second row of Rz(-theta) R = Ry Rx is (0, cos alpha, -sin alpha)
    alpha = np.arctan2(s * r[0, 2] - c * r[1, 2], c * r[1, 1] - s * r[0, 1])
    return float(alpha), float(np.arctan2(-r[2, 0], cos_beta)), float(theta)
