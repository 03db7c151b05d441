"""The convex hull of points in a plane; importing scipy.spatial takes longer than this code runs."""

from __future__ import annotations

import numpy as np

Array = np.ndarray

#: directions whose outermost points leave out what lies within their polygon (Akl & Toussaint, A fast convex hull
#: algorithm, 1978): some per cent of the points are left
_DIRECTIONS = 16


def hull(points: Array) -> Array:
    """The corners (K, 2) of the convex hull of points (N, 2), counter-clockwise; empty if all lie on a line.

    Andrew, Another efficient algorithm for convex hulls in two dimensions, 1979.
    """
    points = points[np.isfinite(points).all(1)]
    if len(points) < 3:  # a triangle has three corners
        return np.zeros((0, 2))
    points = points[_outer(points)]
    points = points[np.lexsort(points.T[::-1])]  # by x, then y
    lower = _chain(points.tolist())
    upper = _chain(points[::-1].tolist())
    corners = np.array(lower[:-1] + upper[:-1])
    return corners if len(corners) > 2 else np.zeros((0, 2))


def _outer(points: Array) -> Array:
    """Return which points (N,) can be corners of the hull."""
    angles = np.arange(_DIRECTIONS) * (2 * np.pi / _DIRECTIONS)
    along = points @ np.stack([np.cos(angles), np.sin(angles)])
    corners = points[along.argmax(0)]
    outer = np.zeros(len(points), bool)
    for a, b in zip(corners, np.roll(corners, -1, 0), strict=True):
        side = (b[0] - a[0]) * (points[:, 1] - a[1]) - (b[1] - a[1]) * (points[:, 0] - a[0])
        outer |= (side <= 0) & (a != b).any()
    return outer


def _chain(points: list[list[float]]) -> list[list[float]]:
    """Return the part of the hull to the right of the path through the sorted points."""
    found: list[list[float]] = []
    for p in points:
        while len(found) > 1:
            (ax, ay), (bx, by) = found[-2], found[-1]
            if (bx - ax) * (p[1] - ay) - (by - ay) * (p[0] - ax) > 0:
                break
            found.pop()
        found.append(p)
    return found


def area(points: Array) -> float:
    """The area of the convex hull of points (N, 2); 0 where they lie on a line."""
    x, y = (hull(points) - points.mean(0)).T if len(points) else np.zeros((2, 0))
    return float(0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum())


def within(points: Array, places: Array) -> Array:
    """Return which points (M, 2) lie in the convex hull of points (N, 2) or on its border; none if these lie on a
    line.
    """
    corners = hull(points)
    inside = np.full(len(places), len(corners) > 0)
    for a, b in zip(corners, np.roll(corners, -1, 0), strict=True):
        inside &= (b[0] - a[0]) * (places[:, 1] - a[1]) - (b[1] - a[1]) * (places[:, 0] - a[0]) >= 0
    return inside
