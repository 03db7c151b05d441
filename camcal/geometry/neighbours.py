"""Nearest neighbours: by brute force for few points, by scipy's k-d tree for many.

Importing scipy.spatial takes a quarter of a second, longer than all searches of an ordinary calibration take by brute
force.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray

#: distances up to which all are computed: 5 ms
FEW = 250_000


class Neighbours:
    """An index of points (N, D) for nearest-neighbour queries."""

    def __init__(self, points: Array):
        self.points = np.asarray(points, float)
        self._tree = None

    def query(self, at: Array, k: int = 1) -> tuple[Array, Array]:
        """Distances and indices (..., k) of the points nearest to positions (..., D), nearest first.

        Without the last axis where k is 1. Where there are fewer than k points, distances are infinite and numbers N,
        as in scipy.
        """
        at = np.asarray(at, float)
        flat = at.reshape(-1, at.shape[-1])
        if len(flat) * len(self.points) > FEW:
            found = self._large().query(at, k=k)
            return np.asarray(found[0]), np.asarray(found[1])
        squares = _squares(flat, self.points)
        count = min(k, len(self.points))
        if count < squares.shape[1] and count:
            near = np.argpartition(squares, count - 1, axis=1)[:, :count]
        else:
            near = np.broadcast_to(np.arange(squares.shape[1]), squares.shape)
        own = np.take_along_axis(squares, near, 1)
        order = np.lexsort((near, own), axis=1)  # of equal distances the first point
        distance = np.full((len(flat), k), np.inf)
        number = np.full((len(flat), k), len(self.points))
        distance[:, :count] = np.sqrt(np.take_along_axis(own, order, 1))
        number[:, :count] = np.take_along_axis(near, order, 1)
        shape = at.shape[:-1] if k == 1 else (*at.shape[:-1], k)
        return distance.reshape(shape), number.reshape(shape)

    def pairs(self, reach: float) -> Array:
        """Pairs (K, 2) of points i < j that are at most `reach` apart."""
        if len(self.points) ** 2 > FEW:
            return np.asarray(self._large().query_pairs(reach, output_type="ndarray"))
        near = np.triu(_squares(self.points, self.points) <= reach * reach, 1)
        return np.argwhere(near)

    def within(self, reach: Array) -> list[Array]:
        """The indices of the points within reach (N,) of each point, itself included."""
        if len(self.points) ** 2 > FEW:
            return [np.array(near, int) for near in self._large().query_ball_point(self.points, reach)]
        return [np.flatnonzero(row) for row in _squares(self.points, self.points) <= reach[:, None] ** 2]

    def _large(self):  # type: ignore[no-untyped-def]
        if self._tree is None:
            from scipy.spatial import cKDTree  # see above

            self._tree = cKDTree(self.points)
        return self._tree


def _squares(a: Array, b: Array) -> Array:
    """Squared distances (N, M) of points (N, D) from (M, D)."""
    found = np.zeros((len(a), len(b)))
    for one, other in zip(a.T, b.T, strict=True):
        off = one[:, None] - other
        off *= off
        found += off
    return found


def spacing(points: Array) -> float:
    """The median distance of points (N, D) from their nearest neighbour."""
    return float(np.median(Neighbours(points).query(points, k=2)[0][:, 1]))
