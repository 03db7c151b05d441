"""What boards of identified markers share: finding the markers, then every corner near them.

The markers' own corners are only a start. Those that fit to their neighbours give local homographies (no lens
is assumed, so a wide angle does no harm), these say where each corner of the board lies, also beside a marker
that was not read, and the corners are then fitted as the saddles of grey value that they are.
"""

from __future__ import annotations

import time
from abc import abstractmethod
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from camcal.geometry import homography
from camcal.targets import dictionaries, saddle
from camcal.targets.base import DEFAULT_SECONDS, Detection, Miss, Target

Array = np.ndarray

FIRST_PIXELS = 1.5e6  #: size to which a picture is reduced for the first search
NEIGHBOURS = 8  #: markers around one that it is compared with
SUPPORT = 4  #: markers that say where a corner is
WINDOW_SHARE = 0.85  #: of the space around a corner that its fit uses; the rest bears the error of the start
START_BLUR = 1.5  #: px; the starts come from markers whose corners are off by a px or two
ROUNDS = 8  #: of fitting the neighbours of what is known
LOCAL_POINTS = 12  #: known points whose homography says where another is
LEAST_GAP = 1e-3  #: of a homography's equations; below it the points stand in a row
STRAY = 0.5  #: of the window; farther off than that, a fitted point is another corner
LEAST_POINTS = 4  #: fewer say nothing of a pose
AGREE = 0.3  #: how far a marker may be from where its neighbour expects it, of their distance
REACH = 1.2  #: pitches from a corner to the nearest marker that was read


class TagBoard(Target):
    """A board with markers of a dictionary.

    Attributes
    ----------
    dictionary : str
    border : int
        Width of the markers' black border, in cells.
    """

    dictionary: str
    border: int = 1

    @property
    @abstractmethod
    def tag_ids(self) -> Array:
        """Ids of the markers (K,)."""

    @property
    @abstractmethod
    def tag_corners(self) -> Array:
        """Their corners (K, 4, 2) in the board's frame, in the order in which cv2 finds them."""

    @property
    @abstractmethod
    def window(self) -> float:
        """Half the side of the square around a point that holds no edges but its own, in `unit`."""

    @property
    @abstractmethod
    def pitch(self) -> float:
        """Distance of neighbouring markers, in `unit`."""

    def find(self, gray: Array, seconds: float = DEFAULT_SECONDS) -> Detection | Miss:
        """Look for the board; a part of it is enough."""
        start = time.perf_counter()
        picture = to_8_bits(gray)
        tags, corners = np.zeros(0, int), np.zeros((0, 4, 2))
        for factor in reductions(picture.shape):
            began = time.perf_counter()
            tags, corners = self._markers(picture, factor)
            spent = time.perf_counter() - began
            left = seconds - (time.perf_counter() - start)
            if len(tags) >= 2 or 5 * spent > left:  # the next picture is four times as large
                break
        if len(tags) < 2:
            return Miss("none", _said(len(tags), self.dictionary))
        return self._corners(gray, tags, corners)

    def _markers(self, picture: Array, factor: int) -> tuple[Array, Array]:
        """Markers of this board (rows of `tag_ids`) that agree with each other, in px of the full picture."""
        ids, corners = dictionaries.detect(reduced(picture, factor), self.dictionary, self.border)
        corners = (corners + 0.5) * factor - 0.5
        own = {int(tag): k for k, tag in enumerate(self.tag_ids)}
        rows = [i for i, tag in enumerate(ids) if int(tag) in own]
        tags = np.array([own[int(ids[i])] for i in rows], int)
        keep = consistent(self.tag_corners[tags], corners[rows])
        return tags[keep], corners[rows][keep]

    def _corners(self, gray: Array, tags: Array, corners: Array) -> Detection | Miss:
        """Fit every point near the markers, then those near fitted points, until no more are found."""
        points = self.points[:, :2]
        known = Known.of(len(points))
        ids, uv, jacobian = locate(points, self.tag_corners[tags], corners, REACH * self.pitch)
        for _ in range(ROUNDS):
            inside = in_picture(uv, gray.shape)
            ids, uv, jacobian = ids[inside], uv[inside], jacobian[inside]
            if not len(ids) or not known.add(ids, self._fit(gray, ids, uv, jacobian), jacobian):
                break
            known.drop_strays(points, self.window)
            ids, uv, jacobian = known.neighbours(points, REACH * self.pitch)
        found = np.flatnonzero(known.good)
        if len(found) < LEAST_POINTS:
            return Miss(
                "none", f"{len(tags)} markers were found, but only {len(found)} corners could be fitted"
            )
        scale = grey_scale(gray)
        info = {
            "rejected": {i: r for i, r in sorted(known.reasons.items()) if not known.good[i]},
            "markers": len(tags),
            "square_px": float(np.median(np.linalg.norm(known.jacobian[found], axis=1)) * self.square),
            "blur_px": float(np.median(known.blur[found])),
            "contrast": float(np.median(np.abs(known.contrast[found])) * 255 / scale),
            "noise": float(np.median(known.noise[found]) * 255 / scale),
            "covariance": known.covariance[found],
        }
        sigma = np.sqrt(0.5 * np.trace(known.covariance[found], axis1=1, axis2=2))
        return Detection(found, known.uv[found], sigma, info)

    def _fit(self, gray: Array, ids: Array, uv: Array, jacobian: Array) -> saddle.Corners:
        # the window as a share of a fictitious square, whose sides the fit judges distances by
        sides = np.swapaxes(jacobian, 1, 2) * (self.window / saddle.HALF)
        return saddle.refine(gray, uv, sides, WINDOW_SHARE * saddle.HALF, START_BLUR, grey_scale(gray))


@dataclass
class Known:
    """What is known so far of each point of a board: arrays over all M points, valid where `good`."""

    good: Array
    uv: Array
    jacobian: Array
    covariance: Array
    blur: Array
    contrast: Array
    noise: Array
    reasons: dict[int, str]

    @classmethod
    def of(cls, count: int) -> Known:
        """Nothing known of `count` points."""
        one, two, square = np.zeros(count), np.zeros((count, 2)), np.zeros((count, 2, 2))
        return cls(one > 0, two, square, square.copy(), one.copy(), one.copy(), one.copy(), {})

    def add(self, ids: Array, found: saddle.Corners, jacobian: Array) -> int:
        """Take the good ones of newly fitted points; how many those are."""
        good = found.good
        rows = ids[good]
        self.good[rows] = True
        self.uv[rows], self.covariance[rows], self.jacobian[rows] = (
            found.uv[good],
            found.covariance[good],
            jacobian[good],
        )
        self.blur[rows], self.contrast[rows], self.noise[rows] = (
            found.blur[good],
            found.contrast[good],
            found.noise[good],
        )
        self.reasons |= {int(i): r for i, r in zip(ids, found.reasons, strict=True) if r}
        return int(good.sum())

    def drop_strays(self, points: Array, window: float) -> None:
        """Reject points that are not where their neighbours alone put them."""
        rows = np.flatnonzero(self.good)
        if len(rows) <= LOCAL_POINTS:
            return
        uv, jacobian, certain = from_points(points[rows], points[rows], self.uv[rows], leave_out=True)
        room = np.linalg.norm(jacobian, axis=1).min(1) * window
        stray = certain & (np.linalg.norm(uv - self.uv[rows], axis=1) > np.maximum(STRAY * room, 1.5))
        self.good[rows[stray]] = False
        self.reasons |= {int(i): "not where its neighbours say" for i in rows[stray]}

    def neighbours(self, points: Array, reach: float) -> tuple[Array, Array, Array]:
        """Where the points within `reach` of good ones must be: ids, uv and d uv / d point."""
        rows, open_ = np.flatnonzero(self.good), np.flatnonzero(~self.good)
        if len(rows) < 4 or not len(open_):
            return open_[:0], np.zeros((0, 2)), np.zeros((0, 2, 2))
        near = np.asarray(cKDTree(points[rows]).query(points[open_])[0]) < reach
        ids = open_[near]
        uv, jacobian, certain = from_points(points[ids], points[rows], self.uv[rows])
        return ids[certain], uv[certain], jacobian[certain]


def from_points(at: Array, points: Array, uv: Array, leave_out: bool = False) -> tuple[Array, Array, Array]:
    """Map points of the board by the homographies of the nearest known points.

    Parameters
    ----------
    at : (N, 2) array
        Points to map.
    points, uv : (K, 2) arrays
        Known points and their images.
    leave_out : bool
        Whether `at` is `points`, and each is to be mapped by the others only.

    Returns
    -------
    uv : (N, 2) array
    jacobian : (N, 2, 2) array
    certain : (N,) bool array
        Where the nearest points determine a homography: not where they stand in a row.
    """
    skip = int(leave_out)
    count = min(LOCAL_POINTS, len(points) - skip)
    if not len(at) or count < 4:
        return np.zeros((len(at), 2)), np.zeros((len(at), 2, 2)), np.zeros(len(at), bool)
    near = np.asarray(cKDTree(points).query(at, k=count + skip)[1])[:, skip:]
    h, gap, _ = homography.solve(points[near], uv[near], steps=1)
    image, jacobian = transfer(h, at)
    return image, jacobian, (gap > LEAST_GAP) & np.isfinite(image).all(1)


def transfer(h: Array, at: Array) -> tuple[Array, Array]:
    """Images (N, 2) of points (N, 2), each under its own homography (N, 3, 3), with Jacobians (N, 2, 2)."""
    with np.errstate(all="ignore"):
        image = np.einsum("nij,nj->ni", h, np.c_[at, np.ones(len(at))])
        uv = image[:, :2] / image[:, 2:]
        return uv, (h[:, :2, :2] - uv[:, :, None] * h[:, 2:, :2]) / image[:, 2:, None]


def grey_scale(gray: Array) -> float:
    """The grey value of white: 255, or the brightest of 16 bits."""
    return float(gray.max()) if gray.dtype == np.uint16 else 255.0


def to_8_bits(gray: Array) -> Array:
    """The picture in 8 bits for cv2's detectors; one of 16 bits is stretched to its own range."""
    if gray.dtype == np.uint8:
        return gray
    low, high = float(gray.min()), float(gray.max())
    return ((gray - low) * (255.0 / max(high - low, 1.0))).astype(np.uint8)


def reductions(shape: tuple[int, ...]) -> list[int]:
    """Factors by which a picture is reduced, the coarsest first and 1 last."""
    factors, pixels = [1], shape[0] * shape[1]
    while pixels / factors[0] ** 2 > FIRST_PIXELS:
        factors.insert(0, 2 * factors[0])
    return factors


def reduced(picture: Array, factor: int) -> Array:
    """The picture `factor` times smaller; pixel u of it is (u + 0.5) factor - 0.5 of the picture."""
    if factor == 1:
        return picture
    return cv2.resize(picture, None, fx=1 / factor, fy=1 / factor, interpolation=cv2.INTER_AREA)


def _said(count: int, name: str) -> str:
    found = "no marker" if not count else "one marker"
    return f"{found} of {name} of this board was found; at least 2 that fit together are needed"


def consistent(board: Array, corners: Array) -> Array:
    """Indices of the largest set of markers of which neighbours expect each other where they are.

    Parameters
    ----------
    board, corners : (K, 4, 2) arrays
        The markers' corners on the board and in the picture.
    """
    if len(board) < 2:
        return np.zeros(0, int)
    h = homography.homographies(board, corners, steps=0)
    on_board, centre = board.mean(1), corners.mean(1)
    count = min(NEIGHBOURS + 1, len(board))
    near = np.asarray(cKDTree(on_board).query(on_board, k=count)[1])
    a = np.repeat(np.arange(len(board)), count - 1)
    b = near[:, 1:].ravel()
    expected = homography.transfer(h[a], on_board[b][:, None])[:, 0]
    distance = np.linalg.norm(centre[a] - centre[b], axis=1)
    with np.errstate(invalid="ignore"):
        fits = np.linalg.norm(expected - centre[b], axis=1) < AGREE * distance
    links = csr_array((fits, (a, b)), shape=(len(board), len(board)))
    both = links.multiply(links.T)
    number, label = connected_components(both, directed=False)
    members = np.flatnonzero(label == np.bincount(label, minlength=number).argmax())
    return members if len(members) >= 2 else np.zeros(0, int)


def locate(points: Array, board: Array, corners: Array, reach: float) -> tuple[Array, Array, Array]:
    """Where the points near known markers lie in the picture, by local homographies.

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
    distance, near = (np.asarray(a) for a in cKDTree(board.mean(1)).query(points, k=count))
    ids = np.flatnonzero(distance[:, 0] < reach)
    near, distance = near[ids], distance[ids]
    weights = np.repeat(np.exp(-((distance / distance[:, :1]) ** 2)), 4, axis=1)  # the nearest decides
    h = homography.homographies(
        board[near].reshape(len(ids), -1, 2), corners[near].reshape(len(ids), -1, 2), weights, steps=1
    )
    return ids, *transfer(h, points[ids])


def in_picture(uv: Array, shape: tuple[int, ...]) -> Array:
    """Which pixels (N, 2) lie in a picture of (rows, columns)."""
    with np.errstate(invalid="ignore"):
        return (uv >= -0.5).all(1) & (uv[:, 0] <= shape[1] - 0.5) & (uv[:, 1] <= shape[0] - 0.5)
