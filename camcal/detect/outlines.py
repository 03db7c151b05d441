"""Separate dark squares: their outlines in a picture, and their corners as intersections of fitted edges.

The corner of a single dark square is not a saddle of the grey values. It is located as the intersection of two
straight edges: each edge is located in profiles across it, where they cross the middle between dark and bright, and a
line is fitted to these points. Distortion bends the edges by an amount that is known from the corners of all squares
(`camcal.detect.targets.outlined`); the line is then the chord of an arc.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from camcal.detect.discs import BLUR, CONCENTRIC, THRESHOLD, Discs, dark_outlines, distinct
from camcal.records import dataclass

Array = np.ndarray

LEAST_SIDE = 6.0  #: px; in smaller squares blur reaches from edge to edge
CORNER = 0.05  #: of the perimeter, by which an outline may deviate from its quadrilateral
MOST_ANGLE = 0.85  #: |cosine| of the angle at a corner: a square seen at a slant of 60 degrees has less
#: of a side, and px, at each end where no profile is taken because of the blur of the adjacent edge
ENDS, ENDS_PX = 0.15, 2.5
SPACING = 1.0  #: px between profiles; closer ones share pixels
STEP = 0.5  #: px between the samples of a profile
LONGEST, SHORTEST = 4.0, 2.0  #: px that a profile extends to each side
REACH = 0.45  #: of the distance to the next edge that a profile uses
ROUNDS = 3  #: of measuring the edges from the corners found last
LEAST_PROFILES = 3  #: of a side; fewer do not show how well a line fits
STRAIGHT = 0.5  #: px; an edge whose points scatter by more is bent, or is not an edge
#: the outer fifths of a profile give the levels of both sides; with quarters to eighths the corners scatter by .011 to
#: .012 px, or .048 to .053 at a blur of 1.5 px; with halves by .074
PLATEAUS = 5
PLAIN = 0.1  #: of the contrast; largest standard deviation inside a printed square
FLOOR = 0.02  #: px; least scatter of a point: that of interpolation and 8 bits without noise


@dataclass(frozen=True)
class Squares:
    """Fitted squares.

    Attributes
    ----------
    corners : (K, 4, 2) array
        px, clockwise.
    covariance : (K, 4, 2, 2) array
        px².
    good : (K,) bool array
        Whether all four edges could be measured.
    contrast : (K,) array
        Half the difference of outside and inside, grey levels.
    blur : (K,) array
        Width (sigma) of the edges, px.
    """

    corners: Array
    covariance: Array
    good: Array
    contrast: Array
    blur: Array

    def take_corners(self, order: Array) -> Squares:
        """Return the same squares with their corners in another order."""
        return replace(self, corners=self.corners[:, order], covariance=self.covariance[:, order])


def find_squares(gray: Array) -> Array:
    """Dark quadrilaterals (K, 4, 2) of a grey uint8 picture, clockwise, px, each once."""
    smooth = cv2.GaussianBlur(gray, (0, 0), BLUR)
    found = [q for q in map(_quadrilateral, dark_outlines(smooth)) if q is not None]
    if not found:
        return np.zeros((0, 4, 2))
    quads = np.array(found)
    quads = quads[_dark_inside(smooth, quads)]
    discs = as_discs(quads)
    kept = distinct(discs)
    rows = [int(np.abs(discs.centre - c).sum(1).argmin()) for c in kept.centre]
    return quads[rows]


def _quadrilateral(outline: Array) -> Array | None:
    """The corners (4, 2) of an outline, clockwise, if it is a convex quadrilateral."""
    length = cv2.arcLength(outline, True)
    if length < 4 * LEAST_SIDE:
        return None
    corners = cv2.approxPolyDP(outline, CORNER * length, True)[:, 0].astype(float)
    if len(corners) != 4 or not cv2.isContourConvex(corners.astype(np.float32)):
        return None
    sides = np.roll(corners, -1, 0) - corners
    lengths = np.linalg.norm(sides, axis=1)
    unit = sides / np.maximum(lengths, 1e-9)[:, None]
    if lengths.min() < LEAST_SIDE or np.abs((unit * np.roll(unit, -1, 0)).sum(1)).max() > MOST_ANGLE:
        return None
    turns = sides[0, 0] * sides[1, 1] - sides[0, 1] * sides[1, 0]
    return corners if turns > 0 else corners[::-1].copy()  # y points down: positive is clockwise


def as_discs(quads: Array) -> Discs:
    """Ellipses with the centres and foreshortening of quadrilaterals, from which grids are grown."""
    centre = quads.mean(1)
    along = 0.25 * (quads[:, 1] + quads[:, 2] - quads[:, 0] - quads[:, 3])
    across = 0.25 * (quads[:, 2] + quads[:, 3] - quads[:, 0] - quads[:, 1])
    half = np.stack([along, across], 2)  # columns: half the sides
    values, vectors = np.linalg.eigh(half @ half.transpose(0, 2, 1))
    shape = (vectors * np.sqrt(np.maximum(values, 1e-9))[:, None]) @ vectors.transpose(0, 2, 1)
    return Discs(centre, shape)


def plain_inside(gray: Array, quads: Array) -> tuple[Array, Array]:
    """Mask (K,) of the squares that are uniformly dark inside, unlike windows and tags, and the contrast (K,) of
    each, grey levels.
    """
    at = np.linspace(-0.6, 0.6, 7)
    x, y = np.meshgrid(at, at)
    weights = 0.25 * np.stack(
        [(1 - x) * (1 - y), (1 + x) * (1 - y), (1 + x) * (1 + y), (1 - x) * (1 + y)], -1
    )
    places = (weights.reshape(-1, 4) @ quads).astype(np.float32)
    inside = cv2.remap(gray, places[..., 0], places[..., 1], cv2.INTER_LINEAR).astype(float)
    centre = quads.mean(1, keepdims=True)
    around = (centre + (1 + CONCENTRIC) * (quads - centre)).astype(np.float32)
    bright = cv2.remap(
        gray, around[..., 0], around[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    contrast = np.median(bright.astype(float), 1) - np.median(inside, 1)
    return inside.std(1) < PLAIN * contrast, contrast


def _dark_inside(gray: Array, quads: Array) -> Array:
    """Mask of the squares that are darker in the middle than outside at least three of their corners."""
    centre = quads.mean(1, keepdims=True)
    at = np.concatenate([centre, centre + (1 + CONCENTRIC) * (quads - centre)], 1).astype(np.float32)
    value = cv2.remap(gray, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    around = np.sort(value[:, 1:].astype(float), 1)
    return around[:, 1] > value[:, 0] + THRESHOLD


def refine_squares(
    gray: Array, quads: Array, room: Array, bows: Array | None = None, rounds: int = ROUNDS
) -> Squares:
    """Measure the edges of squares and intersect them.

    Parameters
    ----------
    gray : (height, width) uint8 or uint16 array
    quads : (K, 4, 2) array
        Initial corners, clockwise, accurate to one or two px.
    room : (K,) array
        Distance from an edge to the next one, inside or outside, px.
    bows : (K, 4) array, optional
        Outward displacement of the middle of the edge from each corner to the next, px; straight by default.
    rounds : int
        Number of times that the edges are measured, each time from the latest corners.
    """
    picture = gray.astype(np.float32)
    count = len(quads)
    bows = np.zeros((count, 4)) if bows is None else bows
    corners, covariance = quads.astype(float).copy(), np.full((count, 4, 2, 2), np.nan)
    good, contrast, blur = np.zeros(count, bool), np.zeros(count), np.zeros(count)
    for k in range(count):
        reach = min(LONGEST, REACH * float(room[k]))
        if reach < SHORTEST:
            continue
        for _ in range(rounds):
            ends = ENDS_PX + reach * _acuteness(corners[k])
            edges = [
                _edge(picture, corners[k, i], corners[k, i - 3], reach, ends[[i, i - 3]], bows[k, i])
                for i in range(4)
            ]
            if any(e is None for e in edges):
                break
            known = [e for e in edges if e is not None]
            crossed = [_crossing(known[i - 1], known[i]) for i in range(4)]
            corners[k] = [c for c, _ in crossed]
            covariance[k] = [v for _, v in crossed]
        else:
            good[k] = bool(np.isfinite(corners[k]).all())
            contrast[k] = np.mean([e.contrast for e in known])
            blur[k] = np.mean([e.blur for e in known])
    return Squares(corners, covariance, good, contrast, blur)


@dataclass(frozen=True)
class _Edge:
    """A line n·x = d, with the variance of its distance along it."""

    normal: Array
    distance: float
    along: Array  #: unit vector
    middle: float  #: mean position of the profiles along the line
    spread: float  #: their sum of squared distances from it
    count: int
    variance: float
    contrast: float
    blur: float

    def variance_at(self, point: Array) -> float:
        """Variance of the line's distance at a point of it, px²."""
        far = float(self.along @ point) - self.middle
        return self.variance * (1 / self.count + far**2 / self.spread)


def _acuteness(corners: Array) -> Array:
    """The cotangent (4,) of acute angles at corners, otherwise 0; profiles near them soon meet the next edge."""
    before, after = np.roll(corners, 1, 0) - corners, np.roll(corners, -1, 0) - corners
    cross = np.abs(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0])
    return np.maximum((before * after).sum(1), 0.0) / np.maximum(cross, 1e-9)


def _edge(picture: Array, start: Array, stop: Array, reach: float, ends: Array, bow: float) -> _Edge | None:
    """The chord of the edge between two corners, dark on its right (inside), whose middle is `bow` px farther out.

    The first and last `ends` px are skipped.
    """
    side = stop - start
    length = float(np.hypot(*side))
    along = side / max(length, 1e-9)
    outward = np.array([along[1], -along[0]])  # clockwise with y down: the left side is outside
    first, last = np.maximum(ENDS * length, ends)
    number = int((length - first - last) / SPACING) + 1
    if number < LEAST_PROFILES:
        return None
    at = np.linspace(first, length - last, number)
    arc = 4 * bow * (at / length) * (1 - at / length)
    offset = np.arange(-reach, reach + 1e-9, STEP)
    places = start + at[:, None, None] * along + (arc[:, None, None] + offset[None, :, None]) * outward
    u, v = np.moveaxis(places.astype(np.float32), -1, 0)
    value = cv2.remap(picture, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(float)
    total, place = _crossings(value, offset)
    usual = float(np.median(total))
    kept = (total > 0.5 * usual) & np.isfinite(place)
    if usual <= 0 or kept.sum() < LEAST_PROFILES:
        return None
    value, total, place, at = value[kept], total[kept], place[kept], at[kept]
    # the slope in the middle of an edge of width sigma is its total rise over sigma sqrt(2 pi)
    slope = np.abs(np.diff(value, axis=1)).max(1) / STEP
    width = total / (np.sqrt(2 * np.pi) * np.maximum(slope, 1e-9))
    design = np.c_[np.ones(len(at)), at - at.mean()]
    fitted, *_ = np.linalg.lstsq(design, place, rcond=None)
    scatter = float(np.sqrt(((place - design @ fitted) ** 2).sum() / (len(at) - 2)))
    if scatter > STRAIGHT:
        return None
    ends = start + (at[[0, -1], None] * along) + (design[[0, -1]] @ fitted)[:, None] * outward
    line = (ends[1] - ends[0]) / np.hypot(*(ends[1] - ends[0]))
    normal = np.array([line[1], -line[0]])
    middle_at = float(line @ ends.mean(0))
    spread = float(((at - at.mean()) ** 2).sum())
    variance = max(scatter, FLOOR) ** 2
    distance = float(normal @ ends[0])
    return _Edge(
        normal, distance, line, middle_at, spread, len(at), variance, 0.5 * usual, float(np.median(width))
    )


def _crossings(value: Array, offset: Array) -> tuple[Array, Array]:
    """The positions where profiles (P, S) reach the middle between their dark and bright ends, nearest to offset 0.

    Returns
    -------
    rise, place : (P,) arrays
        The difference between the ends, and the offset; NaN if the middle is not reached.
    """
    ends = max(1, len(offset) // PLATEAUS)
    dark, bright = value[:, :ends].mean(1), value[:, -ends:].mean(1)
    level = 0.5 * (dark + bright)
    above = value >= level[:, None]
    up = ~above[:, :-1] & above[:, 1:]
    far = np.where(up, np.abs(offset[:-1] + 0.5 * STEP), np.inf)
    i = far.argmin(1)
    rows = np.arange(len(value))
    below, over = value[rows, i], value[rows, i + 1]
    place = offset[i] + STEP * (level - below) / np.where(over > below, over - below, np.nan)
    return bright - dark, np.where(np.isfinite(far[rows, i]), place, np.nan)


def _crossing(one: _Edge, other: _Edge) -> tuple[Array, Array]:
    """The intersection of two lines, and its covariance."""
    normals = np.stack([one.normal, other.normal])
    inverse = np.linalg.inv(normals)
    point = inverse @ np.array([one.distance, other.distance])
    variances = np.array([one.variance_at(point), other.variance_at(point)])
    return point, (inverse * variances) @ inverse.T
