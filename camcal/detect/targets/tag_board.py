"""The common part of boards with markers: finding the markers, then every corner near them.

The corners of the markers are only initial values. Markers consistent with their neighbours give local homographies
(no lens model is assumed, so that wide-angle lenses are no problem). These predict each corner of the board, including
those near markers that were not read, and the corners are then fitted as saddles of the grey values.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import numpy as np

from camcal.detect import saddle
from camcal.detect.board_points import LEAST_GAP, Known, board_from_pixel, locate
from camcal.detect.corners import START_ERROR
from camcal.detect.pyramid import grey_span, reduced, reductions, to_8_bits
from camcal.detect.targets import dictionaries
from camcal.detect.targets.base import (
    DEFAULT_SECONDS,
    LEAST_POINTS,
    Detection,
    Miss,
    Target,
    clock,
    time_for_next,
)
from camcal.geometry import homography
from camcal.geometry.neighbours import Neighbours
from camcal.geometry.picture import in_picture

Array = np.ndarray

NEIGHBOURS = 8  #: nearest markers with which a marker is compared: those around it
WINDOW_SHARE = 0.85  #: of the clear space around a corner that its fit uses; the rest is for initial errors
BAND = 3.0  #: blurs to each side of an edge that a fit uses
START_BLUR = 1.5  #: px; initial corners come from markers, which are off by one or two px
ROUNDS = 8  #: of fitting the neighbours of known points
ENOUGH = 0.5  #: share of the points above which no finer picture is searched
AGREE = 0.3  #: largest deviation of a marker from the prediction of its neighbour, relative to their distance
REACH = 1.2  #: pitches; largest distance from a corner to the nearest marker that was read


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
    first_half, second_half = saddle.HALF, saddle.WIDER_HALF  #: half-widths of the windows, of a cell

    @property
    @abstractmethod
    def tag_ids(self) -> Array:
        """Ids of the markers (K,)."""

    @property
    @abstractmethod
    def tag_corners(self) -> Array:
        """Their corners (K, 4, 2) in the board's frame, in cv2's order."""

    @property
    @abstractmethod
    def cell(self) -> float:
        """The minimum length of the edges through a point, in `unit`: to the next corner."""

    @property
    @abstractmethod
    def clear(self) -> float:
        """The distance from the edges through a point within which there is no other edge, in `unit`."""

    @property
    @abstractmethod
    def pitch(self) -> float:
        """The distance between neighbouring markers, in `unit`."""

    def find(self, gray: Array, seconds: float = DEFAULT_SECONDS) -> Detection | Miss:
        """Search for the board; a part of it is sufficient."""
        start = clock()
        picture = to_8_bits(gray)
        best: Detection | Miss = Miss("none", "no marker of this board was found")
        for factor in reductions(picture.shape, enlarge=True):  # enlarging separates small markers that touch
            began = clock()
            found = self._at_size(gray, picture, factor)
            if isinstance(best, Miss) or (isinstance(found, Detection) and len(found) > len(best)):
                best = found
            spent = clock() - began
            left = seconds - (clock() - start)
            enough = isinstance(best, Detection) and len(best) >= ENOUGH * len(self.points)
            if enough or not time_for_next(spent, left):
                break
        return best

    def _at_size(self, gray: Array, picture: Array, factor: float) -> Detection | Miss:
        tags, corners = self._markers(picture, factor)
        if len(tags) < 2:
            seen = "no marker" if not len(tags) else "one marker"
            said = f"{seen} of {self.dictionary} of this board was found; 2 consistent ones are needed"
            return Miss("none", said)
        near = locate(self.points[:, :2], self.tag_corners[tags], corners, REACH * self.pitch)
        return self.grown(gray, *near, {"markers": len(tags)})

    def _markers(self, picture: Array, factor: float) -> tuple[Array, Array]:
        """Markers of this board (rows of `tag_ids`) that are consistent with each other, in px of the full
        picture.
        """
        ids, corners = dictionaries.detect(reduced(picture, factor), self.dictionary, self.border)
        corners = (corners + 0.5) * factor - 0.5
        own = {int(tag): k for k, tag in enumerate(self.tag_ids)}
        rows = [i for i, tag in enumerate(ids) if int(tag) in own]
        tags = np.array([own[int(ids[i])] for i in rows], int)
        keep = consistent(self.tag_corners[tags], corners[rows])
        return tags[keep], corners[rows][keep]

    def grown(
        self, gray: Array, ids: Array, uv: Array, jacobian: Array, info: dict[str, Any]
    ) -> Detection | Miss:
        """Fit points with known approximate positions, then their neighbours, until no more are found.

        Parameters
        ----------
        gray : (height, width) array
        ids : (N,) int array
        uv : (N, 2) array
            px.
        jacobian : (N, 2, 2) array
            d uv / d point.
        info : mapping
            Further entries of the detection's info.
        """
        points = self.points[:, :2]
        known = Known.of(len(points))
        for _ in range(ROUNDS):
            inside = in_picture(uv, gray.shape[::-1])
            ids, uv, jacobian = ids[inside], uv[inside], jacobian[inside]
            if not len(ids) or not known.add(ids, self._fit(gray, uv, jacobian), jacobian):
                break
            known.drop_strays(points, self.clear)
            ids, uv, jacobian = known.neighbours(points, REACH * self.pitch)
        if len(known.rows) >= LEAST_POINTS:
            self._sharpen(gray, known)
        if len(known.rows) < LEAST_POINTS:
            return Miss(
                "none", f"a board was found, but only {len(known.rows)} of its corners could be fitted"
            )
        _, gap, _ = homography.solve(points[known.rows][None], known.uv[known.rows][None], steps=0)
        if gap[0] < LEAST_GAP:
            said = f"the {len(known.rows)} corners of the board that are visible lie on a line"
            return Miss("cut-off", said + " (all or all but one): they do not determine its pose")
        found, span = known.corners, grey_span(gray)
        info = info | {
            "rejected": {i: r for i, r in sorted(known.reasons.items()) if not known.good[i]},
            "square_px": float(np.median(np.linalg.norm(known.jacobian[known.rows], axis=1)) * self.square),
            "blur_px": float(np.median(found.blur)),
            "contrast": float(np.median(found.contrast) * 255 / span),
            "noise": float(np.median(found.noise) * 255 / span),
            "covariance": found.covariance,
        }
        return Detection(known.rows, found.uv, found.sigma, info)

    def _fit(self, gray: Array, uv: Array, jacobian: Array) -> saddle.Corners:
        sides = np.swapaxes(jacobian, 1, 2) * self.cell
        return saddle.refine(gray, uv, sides, self._half(sides, START_BLUR, self.first_half), START_BLUR)

    def _half(self, sides: Array, blur: Array | float, half: float) -> Array:
        """Half-widths of the windows: long ones include pixels along the edges, which must be clear of other edges.

        An edge may be `START_ERROR` nearer to others than predicted, and the fit uses as much beyond its band.
        """
        px = np.linalg.norm(sides, axis=2).min(1) * (self.clear / self.cell)
        clear = px > BAND * blur + 2 * START_ERROR
        return np.where(clear, half, np.minimum(half, WINDOW_SHARE * self.clear / self.cell))

    def _sharpen(self, gray: Array, known: Known) -> None:
        """Fit the good points once more, given the perspective of their edges and the gradient of the shading."""
        rows, found = known.rows, known.corners
        points = self.points[rows, :2]
        sides = np.swapaxes(known.jacobian[rows], 1, 2) * self.cell
        half = self._half(sides, found.blur, self.second_half)
        again = saddle.sharpen(gray, found, sides, board_from_pixel(points, found.uv), half)
        known.add(rows, again, known.jacobian[rows])


def consistent(board: Array, corners: Array) -> Array:
    """Indices of the largest set of markers that are consistent with their neighbours.

    Parameters
    ----------
    board, corners : (K, 4, 2) arrays
        The markers' corners on the board and in the picture.
    """
    if len(board) < 2:
        return np.zeros(0, int)
    from scipy.sparse import csr_array  # needed for boards of markers only, and slow to import
    from scipy.sparse.csgraph import connected_components

    h = homography.homographies(board, corners, steps=0)
    on_board, centre = board.mean(1), corners.mean(1)
    count = min(NEIGHBOURS + 1, len(board))
    near = Neighbours(on_board).query(on_board, k=count)[1]
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
