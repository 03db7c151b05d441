"""The poses that are consistent with three points and their rays: Grunert's solution (1841), many samples at once.

In the form of Haralick, Lee, Ottenberg & Nölle, Review and analysis of solutions of the three point
perspective pose estimation problem, IJCV 13 (1994), section 3.1: with the distances a = |X₂X₃|, b = |X₁X₃|,
c = |X₁X₂| and the angles α, β, γ between the rays opposite to them, the depths s₁, s₂ = u s₁, s₃ = v s₁
follow from a quartic in v.
"""

from __future__ import annotations

import numpy as np

from camcal.model.pose import Array

#: an imaginary part up to this much of a root is rounding (or noise at a double root)
_REAL = 1e-3


def poses(xyz: Array, rays: Array) -> Array:
    """All poses that put three points on three rays.

    Parameters
    ----------
    xyz : (H, 3, 3) array
        Points of each sample, by rows.
    rays : (H, 3, 3) array
        Unit vectors in the camera's frame, by rows.

    Returns
    -------
    (H, 4, 3, 4) array
        [R | t], cam_from_points; NaN where there are fewer than four solutions, and for points on a line.
    """
    with np.errstate(all="ignore"):
        depths = _depths(xyz, rays)
        cam = depths[..., None] * rays[:, None]
        to, origin = _frames(cam), _frames(xyz)[:, None]
        rotation = to @ np.swapaxes(origin, -1, -2)
        shift = cam[..., 0, :] - np.einsum("hsij,hj->hsi", rotation, xyz[:, 0])
        found = np.concatenate([rotation, shift[..., None]], -1)
    found[~np.isfinite(found).all((2, 3))] = np.nan
    return found


def _depths(xyz: Array, rays: Array) -> Array:
    """Distances (H, 4, 3) of the points along their rays; NaN where a root is complex or not positive."""
    a, b, c = (np.square(xyz[:, i] - xyz[:, j]).sum(1) for i, j in ((1, 2), (0, 2), (0, 1)))
    ca, cb, cg = (np.einsum("hi,hi->h", rays[:, i], rays[:, j]) for i, j in ((1, 2), (0, 2), (0, 1)))
    # p = (a² - c²)/b², q = (a² + c²)/b²: Haralick et al., eq. 9
    p, q = (a - c) / b, (a + c) / b
    v = _roots(
        (p - 1) ** 2 - 4 * c / b * ca**2,
        4 * (p * (1 - p) * cb - (1 - q) * ca * cg + 2 * c / b * ca**2 * cb),
        2 * (p**2 - 1 + 2 * p**2 * cb**2 + 2 * (b - c) / b * ca**2 - 4 * q * ca * cb * cg)
        + 4 * (b - a) / b * cg**2,
        4 * (-p * (1 + p) * cb + 2 * a / b * cg**2 * cb - (1 - q) * ca * cg),
        (1 + p) ** 2 - 4 * a / b * cg**2,
    )  # fmt: skip
    p, ca, cb, cg, b = (x[:, None] for x in (p, ca, cb, cg, b))
    u = ((p - 1) * v**2 - 2 * p * cb * v + 1 + p) / (2 * (cg - v * ca))  # eq. 8
    first = np.sqrt(b / (1 + v**2 - 2 * v * cb))  # eq. 5
    depths = first[..., None] * np.stack([np.ones_like(u), u, v], -1)
    return np.where((depths > 0).all(-1)[..., None], depths, np.nan)


def _roots(*coefficients: Array) -> Array:
    """Real roots (H, 4) of quartics, coefficients (H,) from the highest; NaN for complex ones."""
    c = np.stack(coefficients, -1)
    companion = np.zeros((len(c), 4, 4))
    companion[:, [1, 2, 3], [0, 1, 2]] = 1
    companion[:, 0] = -c[:, 1:] / c[:, :1]
    ok = np.isfinite(companion).all((1, 2))
    found = np.full((len(c), 4), np.nan, complex)
    found[ok] = np.linalg.eigvals(companion[ok])
    real = np.abs(found.imag) <= _REAL * np.maximum(np.abs(found.real), 1.0)
    return np.where(real, found.real, np.nan)


def _frames(points: Array) -> Array:
    """The right-handed frame (..., 3, 3), columns, of three points (..., 3, 3), by rows."""
    first = points[..., 1, :] - points[..., 0, :]
    x = first / np.linalg.norm(first, axis=-1, keepdims=True)
    normal = np.cross(first, points[..., 2, :] - points[..., 0, :])
    z = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], -1)
