"""The black fraction of a small box of the board, computed from exact areas instead of samples.

For a pattern of axis-aligned rectangles (checkerboards, tags) the integral of the blackness is tabulated. It is
bilinear between the edges of the rectangles, so that four look-ups give the exact mean over a box. The outlines of
discs and of other polygons are approximated by half-planes at the scale of the box.
"""

from __future__ import annotations

import numpy as np

from camcal.detect.targets.base import Pattern
from camcal.geometry.neighbours import Neighbours

Array = np.ndarray


class BlackArea:
    """The blackness of a pattern, prepared for averaging over boxes."""

    def __init__(self, pattern: Pattern):
        self.pattern = pattern
        rectangles = [p for p in pattern.polygons if is_rectangle(p)]
        self.others = [np.asarray(p, float) for p in pattern.polygons if not is_rectangle(p)]
        self.rectangles = RectangleIntegral(rectangles) if rectangles else None
        self.circles = np.asarray(pattern.circles, float).reshape(-1, 3)
        self.tree = Neighbours(self.circles[:, :2]) if len(self.circles) else None

    def mean(self, xy: Array, width: Array) -> Array:
        """Mean blackness of boxes of the board, from 0 to 1.

        Parameters
        ----------
        xy : (..., 2) array
            Centres of the boxes, in the pattern's unit.
        width : (..., 2) array
            Their sides along x and y, > 0.
        """
        black = np.zeros(xy.shape[:-1])
        if self.rectangles is not None:
            black += self.rectangles.mean(xy, width)
        if self.tree is not None:
            black += self._discs(xy, width)
        for polygon in self.others:
            black += _ramp(_inside_distance(polygon, xy), width.mean(-1))
        return np.minimum(black, 1.0)

    def _discs(self, xy: Array, width: Array) -> Array:
        """Non-overlapping discs: only the nearest edge can cross a box."""
        assert self.tree is not None
        neighbours = min(2, len(self.circles))
        _, nearest = self.tree.query(xy, k=neighbours)
        black = np.zeros(xy.shape[:-1])
        for index in np.moveaxis(nearest.reshape(*black.shape, neighbours), -1, 0):
            circle = self.circles[index]
            offset = xy - circle[..., :2]
            distance = np.linalg.norm(offset, axis=-1)
            direction = np.abs(offset) / np.maximum(distance, 1e-300)[..., None]
            black += _ramp(circle[..., 2] - distance, np.linalg.norm(direction * width, axis=-1))
        return black


def _ramp(inside: Array, width: Array) -> Array:
    """The fraction of a box of width `width` on the inner side of an edge at distance `inside` from its centre."""
    return np.clip(0.5 + inside / np.maximum(width, 1e-300), 0.0, 1.0)


def is_rectangle(polygon: Array) -> bool:
    """Return whether a polygon is an axis-aligned rectangle."""
    p = np.asarray(polygon, float)
    if p.shape != (4, 2):
        return False
    low, high = p.min(0), p.max(0)
    on_corner = ((p == low) | (p == high)).all()
    steps = np.abs(np.diff(p, axis=0)) > 0
    return bool(on_corner and (steps.sum(1) == 1).all() and (high > low).all())


class RectangleIntegral:
    """The cumulative integral of the blackness of axis-aligned rectangles, tabulated for bilinear interpolation."""

    def __init__(self, rectangles: list[Array]):
        corners = np.array([[*np.min(r, 0), *np.max(r, 0)] for r in rectangles])
        # coincident edges may differ by rounding; cells of such a width would only cost time
        self.x = _distinct(corners[:, [0, 2]])
        self.y = _distinct(corners[:, [1, 3]])
        i0, i1 = _index(self.x, corners[:, 0]), _index(self.x, corners[:, 2])
        j0, j1 = _index(self.y, corners[:, 1]), _index(self.y, corners[:, 3])
        black = np.zeros((len(self.y) - 1, len(self.x) - 1))
        for a, b, c, d in zip(i0, i1, j0, j1, strict=True):
            black[c:d, a:b] = 1.0
        area = black * np.diff(self.y)[:, None] * np.diff(self.x)
        self.table = np.zeros((len(self.y), len(self.x)))
        self.table[1:, 1:] = area.cumsum(0).cumsum(1)

    def mean(self, xy: Array, width: Array) -> Array:
        """Mean blackness of boxes: centres (..., 2) and sides (..., 2)."""
        lower, upper = xy - width / 2, xy + width / 2
        left, right = _position(self.x, lower[..., 0]), _position(self.x, upper[..., 0])
        top, bottom = _position(self.y, lower[..., 1]), _position(self.y, upper[..., 1])
        total = self._at(right, bottom) - self._at(left, bottom) - self._at(right, top) + self._at(left, top)
        return np.clip(total / (width[..., 0] * width[..., 1]), 0.0, 1.0)

    def on_grid(self, x: Array, y: Array) -> Array:
        """Mean blackness (J, I) of the cells between the edges x (I + 1,) and y (J + 1,), both ascending."""
        along = np.stack([np.interp(x, self.x, row) for row in self.table])
        (j, t), rows = _position(self.y, y), along
        both = rows[j] + t[:, None] * (rows[j + 1] - rows[j])
        return np.diff(np.diff(both, axis=0), axis=1) / (np.diff(y)[:, None] * np.diff(x))

    def _at(self, x: tuple[Array, Array], y: tuple[Array, Array]) -> Array:
        (i, s), (j, t) = x, y
        flat, columns = self.table.ravel(), self.table.shape[1]
        k = j * columns + i
        upper = flat[k] + s * (flat[k + 1] - flat[k])
        k += columns
        lower = flat[k] + s * (flat[k + 1] - flat[k])
        return upper + t * (lower - upper)


def _distinct(values: Array) -> Array:
    ordered = np.unique(values)
    tolerance = 1e-9 * (ordered[-1] - ordered[0])
    return ordered[np.r_[True, np.diff(ordered) > tolerance]]


def _index(knots: Array, values: Array) -> Array:
    return np.abs(knots[:, None] - values).argmin(0)


def _position(knots: Array, values: Array) -> tuple[Array, Array]:
    """The cell index and the fraction within it; values outside are clamped to the nearest end."""
    values = np.clip(values, knots[0], knots[-1])
    i = np.clip(np.searchsorted(knots, values, side="right") - 1, 0, len(knots) - 2)
    return i, (values - knots[i]) / (knots[i + 1] - knots[i])


def _inside_distance(polygon: Array, xy: Array) -> Array:
    """Distance to the outline of a simple polygon, positive inside."""
    start, end = polygon, np.roll(polygon, -1, axis=0)
    edge = end - start
    offset = xy[..., None, :] - start
    along = np.clip((offset * edge).sum(-1) / (edge * edge).sum(-1), 0.0, 1.0)
    distance = np.linalg.norm(offset - along[..., None] * edge, axis=-1).min(-1)
    y = xy[..., 1, None]
    crosses = (start[:, 1] > y) != (end[:, 1] > y)
    slope = np.where(edge[:, 1] == 0, 1.0, edge[:, 1])
    right_of = xy[..., 0, None] < start[:, 0] + (y - start[:, 1]) / slope * edge[:, 0]
    inside = (crosses & right_of).sum(-1) % 2 == 1
    return np.where(inside, distance, -distance)
