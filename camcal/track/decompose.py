"""Projection matrices of many frames at once into K, R, t, with first derivatives.

Physical coordinates of a camera, eleven numbers, are in this order:

    fx, fy, skew, cx, cy, rotation δ (3), translation τ (3)

where (δ, τ) moves the camera by x_cam -> exp(δ) x_cam + τ: δ turns it about its own centre.
"""

from __future__ import annotations

import numpy as np

from camcal.geometry import rotations
from camcal.records import dataclass
from camcal.track.keep import stored

Array = np.ndarray

PHYSICAL = 11
FOCAL, SKEW, PRINCIPAL, ROTATION, TRANSLATION = (
    slice(0, 2),
    slice(2, 3),
    slice(3, 5),
    slice(5, 8),
    slice(8, 11),
)

#: where fx, fy, skew, cx, cy stand in K, and the generators of rotations
_PLACES = np.zeros((5, 3, 3))
_PLACES[range(5), [0, 1, 0, 0, 1], [0, 1, 1, 2, 2]] = 1.0
_TURNS = rotations.skew(np.eye(3))


@stored
@dataclass(frozen=True)
class Cameras:
    """Cameras of F frames with the factor of their covariance.

    Attributes
    ----------
    k : (F, 3, 3) array, px
    rotation : (F, 3, 3) array
    translation : (F, 3) array
    factor : (F, 11 + E, n) array
        L with covariance L Lᵀ in the physical coordinates, then the E distortion coefficients.
    extra : (F, E) array
        Distortion coefficients.
    """

    k: Array
    rotation: Array
    translation: Array
    factor: Array
    extra: Array

    @property
    def pose(self) -> Array:
        """[R | t] (F, 3, 4)."""
        return np.concatenate([self.rotation, self.translation[..., None]], -1)

    @property
    def matrix(self) -> Array:
        """K [R | t] (F, 3, 4)."""
        return self.k @ self.pose


def split(matrix: Array) -> tuple[Array, Array, Array]:
    """K, R, t of projection matrices (..., 3, 4) whose points in front have positive depth.

    RQ by Gram-Schmidt from the third row up (Hartley & Zisserman, section 6.2.4): with three rows this
    loses no digits that matter, and it takes all frames at once.

    Returns
    -------
    k : (..., 3, 3) array with k[2, 2] = 1
    rotation : (..., 3, 3) array; of determinant -1 where the world's frame is left-handed
    translation : (..., 3) array
    """
    m = matrix / np.linalg.norm(matrix[..., 2:, :3], axis=-1, keepdims=True)
    m1, m2, r3 = m[..., 0, :3], m[..., 1, :3], m[..., 2, :3]
    cy = _dot(m2, r3)
    m2 = m2 - cy[..., None] * r3
    fy = np.linalg.norm(m2, axis=-1)
    r2 = m2 / fy[..., None]
    cx, skew = _dot(m1, r3), _dot(m1, r2)
    m1 = m1 - skew[..., None] * r2 - cx[..., None] * r3
    fx = np.linalg.norm(m1, axis=-1)
    k = np.zeros((*m.shape[:-2], 3, 3))
    k[..., 0, 0], k[..., 0, 1], k[..., 0, 2] = fx, skew, cx
    k[..., 1, 1], k[..., 1, 2], k[..., 2, 2] = fy, cy, 1.0
    rotation = np.stack([m1 / fx[..., None], r2, r3], -2)
    tz = m[..., 2, 3]
    ty = (m[..., 1, 3] - cy * tz) / fy
    tx = (m[..., 0, 3] - cx * tz - skew * ty) / fx
    return k, rotation, np.stack([tx, ty, tz], -1)


def _dot(a: Array, b: Array) -> Array:
    return np.einsum("...i,...i->...", a, b)


def tangent(k: Array, pose: Array) -> Array:
    """d vec(M) / d physical coordinates (..., 12, 11) of M = K [R | t]; M is stacked by rows.

    Parameters
    ----------
    k : (..., 3, 3) array
    pose : (..., 3, 4) array, [R | t]
    """
    out = np.zeros((*k.shape[:-2], PHYSICAL, 3, 4))
    out[..., :5, :, :] = _PLACES @ pose[..., None, :, :]
    out[..., ROTATION, :, :] = k[..., None, :, :] @ (_TURNS @ pose[..., None, :, :])
    out[..., TRANSLATION, :, 3] = np.swapaxes(k, -1, -2)
    return np.swapaxes(out.reshape(*k.shape[:-2], PHYSICAL, 12), -1, -2)


def unit_last(matrix: Array, derivative: Array) -> tuple[Array, Array]:
    """Scale M (..., 12) to a last element of 1, and the derivative (..., 12, p) with it.

    Returns
    -------
    m : (..., 11) array
    derivative : (..., 11, p) array
    """
    last = matrix[..., 11:]
    m = matrix[..., :11] / last
    return m, (derivative[..., :11, :] - m[..., None] * derivative[..., 11:, :]) / last[..., None]


def noise_columns(figures: dict[str, float], aspect: float, extras: int = 0) -> Array:
    """A factor (11 + extras, c) of the covariance of a motion in physical coordinates.

    fx and fy move together, as the lens does; all else on its own.

    Parameters
    ----------
    figures : mapping of group -> standard deviation, in the units of the parameters
    aspect : float, fy / fx
    """
    columns = np.diag(
        np.repeat(
            [
                figures[g]
                for g in ("focal", "aspect", "skew", "principal", "rotation", "translation", "distortion")
            ],
            [1, 1, 1, 2, 3, 3, extras],
        )
    )
    columns[1, 0] = columns[0, 0] * aspect
    return columns[:, columns.any(0)]
