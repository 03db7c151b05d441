"""Rough camera parameters from rays and pixels, for models that need a starting point."""

from __future__ import annotations

import numpy as np

Array = np.ndarray

#: part of the rays, the innermost, that give the focal length: there every lens is nearly a pinhole camera
INNERMOST = 0.1
#: as many rays at least: three unknowns from two equations each, with some to average over
LEAST_RAYS = 8
#: rad: where even the innermost rays lie farther from the axis (69 degrees), all are used, as of an equidistant lens
FAR = 1.2


def rough_pinhole(rays: Array, uv: Array) -> tuple[float, Array]:
    """The focal length and the pixel (2,) of the optical axis, from the rays nearest to the axis.

    Parameters
    ----------
    rays : (N, 3) array
    uv : (N, 2) array, px
    """
    angle = np.arctan2(np.hypot(rays[:, 0], rays[:, 1]), rays[:, 2])
    inner = angle <= max(np.quantile(angle, INNERMOST), np.sort(angle)[min(LEAST_RAYS, len(angle)) - 1])
    if np.median(angle[inner]) > FAR:
        inner = np.ones(len(angle), bool)
    radial = np.hypot(rays[inner, 0], rays[inner, 1])
    m = rays[inner, :2] * (angle[inner] / np.where(radial > 0, radial, 1.0))[:, None]
    n = inner.sum()
    lines = np.zeros((2 * n, 3))
    lines[:n, 0], lines[n:, 0] = m[:, 0], m[:, 1]
    lines[:n, 1] = lines[n:, 2] = 1.0
    f, cx, cy = np.linalg.lstsq(lines, np.r_[uv[inner, 0], uv[inner, 1]], rcond=None)[0]
    return float(f), np.array([cx, cy])


def image_radii(rays: Array, uv: Array, image_size: tuple[int, int] | None) -> tuple[Array, Array]:
    """Distances of the pixels and of the image corners from the axis, in focal lengths, and the angles of the pixels.

    Returns
    -------
    radius : (N,) or (N + 4,) array
    theta : the same, rad; NaN for the corners
    """
    f, centre = rough_pinhole(rays, uv)
    theta = np.arctan2(np.hypot(rays[:, 0], rays[:, 1]), rays[:, 2])
    if image_size is not None:
        w, h = image_size
        corners = np.array([[0, 0], [w - 1, 0], [0, h - 1], [w - 1, h - 1]], float)
        uv, theta = np.concatenate([uv, corners]), np.r_[theta, np.full(4, np.nan)]
    return np.linalg.norm(uv - centre, axis=1) / abs(f), theta
