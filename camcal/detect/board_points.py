"""Prediction of the points of a board in a picture from those already known.

No lens model is assumed: a point is predicted by the homography of its nearest known neighbours, which is accurate
enough with wide-angle lenses and on bent sheets.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from camcal.detect.corners import Corners
from camcal.detect.edge_model import COUNT
from camcal.geometry import homography
from camcal.geometry.neighbours import Neighbours
from camcal.records import dataclass

Array = np.ndarray

LOCAL_POINTS = 12  #: known points whose homography predicts another: a block of 3x4, three times the minimum
LEAST_GAP = (
    1e-3  #: least second singular value of a homography's equations; below it the points are collinear
)
LEAST_ROOM = (
    1.5  #: px; a point this near to its prediction cannot be another corner: the innermost ring is 3 px
)
STRAY = 0.5  #: of the distance to the next corner; a fitted point farther off is another corner
SUPPORT = 4  #: markers whose corners predict a point: those around it


@dataclass
class Known:
    """What is known so far of the M points of a board: arrays over all points, valid where `good`."""

    good: Array
    uv: Array
    jacobian: Array
    covariance: Array
    params: Array
    noise: Array
    reasons: dict[int, str]

    @classmethod
    def of(cls, count: int) -> Known:
        """The initial state, with none of `count` points known."""
        square = np.zeros((count, 2, 2))
        params = np.zeros((count, COUNT))
        return cls(
            np.zeros(count, bool), np.zeros((count, 2)), square, square.copy(), params, np.zeros(count), {}
        )

    @property
    def rows(self) -> Array:
        """Ids of the good points, ascending."""
        return np.flatnonzero(self.good)

    @property
    def corners(self) -> Corners:
        """The good points as fitted corners."""
        k = self.rows
        return Corners(self.uv[k], self.covariance[k], self.params[k], self.noise[k], ("",) * len(k))

    def add(self, ids: Array, found: Corners, jacobian: Array) -> int:
        """Add the good ones of newly fitted points; return how many were added."""
        good = found.good
        rows = ids[good]
        self.good[ids] = good
        self.uv[rows], self.jacobian[rows] = found.uv[good], jacobian[good]
        self.covariance[rows], self.params[rows] = found.covariance[good], found.params[good]
        self.noise[rows] = found.noise[good]
        self.reasons |= {int(i): r for i, r in zip(ids, found.reasons, strict=True) if r}
        return int(good.sum())

    def drop_strays(self, points: Array, room: float) -> None:
        """Reject points far from where their neighbours predict them; `room` is the distance to other corners."""
        rows = np.flatnonzero(self.good)
        if len(rows) <= LOCAL_POINTS:
            return
        stray = strays(points[rows], self.uv[rows], STRAY * room)
        self.good[rows[stray]] = False
        self.reasons |= {int(i): "not where its neighbours predict" for i in rows[stray]}

    def neighbours(self, points: Array, reach: float) -> tuple[Array, Array, Array]:
        """The predicted positions of points within `reach` of good ones: ids, uv and d uv / d point."""
        rows, missing = np.flatnonzero(self.good), np.flatnonzero(~self.good)
        if len(rows) < 4 or not len(missing):
            return missing[:0], np.zeros((0, 2)), np.zeros((0, 2, 2))
        near = Neighbours(points[rows]).query(points[missing])[0] < reach
        ids = missing[near]
        uv, jacobian, certain = from_points(points[ids], points[rows], self.uv[rows])
        return ids[certain], uv[certain], jacobian[certain]


def board_from_pixel(points: Array, uv: Array) -> Callable[[Array], Array]:
    """A map from px (K, P, 2) around each of K points to the board, by the homography of its neighbours."""
    count = min(LOCAL_POINTS, len(points))
    near = Neighbours(points).query(points, k=count)[1]
    h, gap, _ = homography.solve(uv[near], points[near], steps=1)
    h[gap < LEAST_GAP] = np.nan

    def apply(pixels: Array) -> Array:
        return homography.transfer(h, pixels)

    return apply


def strays(points: Array, uv: Array, room: float) -> Array:
    """Mask (N,) of the points that are too far from where their neighbours predict them.

    Parameters
    ----------
    points : (N, 2) array
        On the board.
    uv : (N, 2) array
        Their images, px.
    room : float
        Largest permitted deviation, in the unit of the board; in the picture it is at least `LEAST_ROOM`.
    """
    predicted, jacobian, certain = from_points(points, points, uv, leave_out=True)
    limit = np.maximum(room * np.linalg.norm(jacobian, axis=1).min(1), LEAST_ROOM)
    return np.asarray(certain & (np.linalg.norm(predicted - uv, axis=1) > limit))


def from_points(at: Array, points: Array, uv: Array, leave_out: bool = False) -> tuple[Array, Array, Array]:
    """Map points of the board by the homographies of the nearest known points.

    Parameters
    ----------
    at : (N, 2) array
        Points to map.
    points, uv : (K, 2) arrays
        Known points and their images.
    leave_out : bool
        Map each point by the other points only; requires that `at` is `points`.

    Returns
    -------
    uv : (N, 2) array
    jacobian : (N, 2, 2) array
    certain : (N,) bool array
        Where the nearest points determine a homography; they do not if they are collinear.
    """
    skip = int(leave_out)
    count = min(LOCAL_POINTS, len(points) - skip)
    if not len(at) or count < 4:
        return np.zeros((len(at), 2)), np.zeros((len(at), 2, 2)), np.zeros(len(at), bool)
    near = Neighbours(points).query(at, k=count + skip)[1][:, skip:]
    h, gap, _ = homography.solve(points[near], uv[near], steps=1)
    image, jacobian = transfer(h, at)
    return image, jacobian, (gap > LEAST_GAP) & np.isfinite(image).all(1)


def transfer(h: Array, at: Array) -> tuple[Array, Array]:
    """Images (N, 2) of points (N, 2), each under its own homography (N, 3, 3), with Jacobians (N, 2, 2)."""
    with np.errstate(all="ignore"):
        image = np.einsum("nij,nj->ni", h, np.c_[at, np.ones(len(at))])
        uv = image[:, :2] / image[:, 2:]
        return uv, (h[:, :2, :2] - uv[:, :, None] * h[:, 2:, :2]) / image[:, 2:, None]


def locate(points: Array, board: Array, corners: Array, reach: float) -> tuple[Array, Array, Array]:
    """Predict the positions in the picture of points near known markers, by local homographies.

    Parameters
    ----------
    points : (M, 2) array
        All points of the board.
    board, corners : (K, 4, 2) arrays
        The markers' corners on the board and in the picture, K >= 2.
    reach : float
        Largest distance from a point to the centre of the nearest marker.

    Returns
    -------
    ids : (N,) int array
        Rows of `points`, ascending.
    uv : (N, 2) array
    jacobian : (N, 2, 2) array
        d uv / d point.
    """
    count = min(SUPPORT, len(board))
    distance, near = Neighbours(board.mean(1)).query(points, k=count)
    ids = np.flatnonzero(distance[:, 0] < reach)
    near, distance = near[ids], distance[ids]
    weights = np.repeat(np.exp(-((distance / distance[:, :1]) ** 2)), 4, axis=1)  # the nearest dominates
    h = homography.homographies(
        board[near].reshape(len(ids), -1, 2), corners[near].reshape(len(ids), -1, 2), weights, steps=1
    )
    return ids, *transfer(h, points[ids])
