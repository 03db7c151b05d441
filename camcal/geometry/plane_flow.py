"""The image motion of a plane: the velocity of each of its points from eight coefficients.

Where a plane moves before a camera, the homography to its picture changes at some rate, and a point (x, y) of the
picture moves with

    x' = c0 + c1 x + c2 y + x (c6 x + c7 y),    y' = c3 + c4 x + c5 y + y (c6 x + c7 y)                  (1)

(Longuet-Higgins & Prazdny, The interpretation of a moving retinal image, 1980, for a plane). Coordinates are counted
from the middle of the picture in units of its longer side, velocities are in px per unit of time.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray

COUNT = 8
LEAST_POINTS = 6  #: four determine the eight numbers; two more leave something to average


def fit_flow(uv: Array, moved: Array, size: tuple[int, int]) -> Array | None:
    """Fit the coefficients (8,) of (1) by least squares.

    Parameters
    ----------
    uv : (N, 2) array
        Points, px.
    moved : (N, 2) array
        Their displacements in a unit of time, px.
    size : (width, height)
        Of the picture, px.

    Returns
    -------
    array, or None where there are fewer than `LEAST_POINTS` points or they lie on a line.
    """
    if len(uv) < LEAST_POINTS:
        return None
    design = _design(uv, size).reshape(-1, COUNT)
    found, _, rank, _ = np.linalg.lstsq(design, np.asarray(moved, float).ravel(), rcond=1e-9)
    return np.asarray(found) if rank == COUNT else None


def flow_at(flow: Array, uv: Array, size: tuple[int, int]) -> Array:
    """Velocities (N, 2) of points uv (N, 2) by (1), px."""
    return np.asarray(_design(uv, size) @ np.asarray(flow, float))


def _design(uv: Array, size: tuple[int, int]) -> Array:
    """The derivatives (N, 2, 8) of the velocities with respect to the coefficients."""
    x, y = ((uv - (np.asarray(size) - 1) / 2) / max(size)).T
    zero, one = np.zeros_like(x), np.ones_like(x)
    along = [one, x, y, zero, zero, zero, x * x, x * y]
    across = [zero, zero, zero, one, x, y, x * y, y * y]
    return np.stack([np.stack(along, -1), np.stack(across, -1)], 1)
