"""Dark discs in a picture, as marks from which a grid is grown.

The image of a disc is an ellipse, which gives the local foreshortening of the plane: in the metric in which the
ellipse is the unit circle, the four neighbours of a disc are equally distant and at right angles, however the board
is tilted.
"""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from camcal.detect.grid import NEAREST, Marks, neighbours
from camcal.geometry.neighbours import Neighbours
from camcal.records import dataclass

Array = np.ndarray

LEAST_AREA = 20.0  #: px of the reduced picture; a smaller disc is distorted too much by the pixel grid
LEAST_OUTLINE = 12  #: px; length of the outline of such a disc
MOST_SLENDER = 6.0  #: ratio of the axes: a tilt of 80 degrees
#: of the area of an outline, by which that of the ellipse with its second moments may differ: that of a square
#: differs by .05 (`ROUND` excludes it), that of a triangle by .21. Of the 4,132 outlines in 47 real pictures that pass
#: all other tests, 1.7 % exceed it
AREA_TOLERANCE = 0.13
ROUND = 0.045  #: of the radius, by which an outline may deviate from its ellipse; a square's deviates by 0.1
PIXEL = 0.3  #: px; deviation of any outline caused by the pixel grid: 1 / sqrt(12), rounded up
THRESHOLD = 8  #: grey levels of 255 by which a disc is darker than its surroundings
WINDOWS = (24, 8, 3)  #: the longer side of the picture divided by the window of the adaptive threshold
#: px; least side of that window: twice the width of the smallest disc; 4 to 24 find the same
LEAST_WINDOW = 10
#: px; blur of the picture before outlines are extracted, to suppress single pixels of noise; .3 to 2.4 find the same
BLUR = 0.8
AROUND = 1.35  #: of the radius; where a disc's surroundings are sampled: half way to a touching neighbour
MOST_DISCS = 3000  #: the largest are kept, which limits the time spent on textures; boards have a few hundred
CONCENTRIC = 0.3  #: of the smaller radius; two outlines whose centres are closer are one disc
SPREAD = 1.8  #: ratio of the radii of neighbours: a wide-angle lens halves a radius over several discs
SAME = 1.25  #: ratio of the distances of neighbours in the metric of a disc; the diagonal has 1.41


@dataclass(frozen=True)
class Discs:
    """Ellipses in a picture.

    Attributes
    ----------
    centre : (N, 2) array
        px.
    shape : (N, 2, 2) array
        Symmetric matrices S; the outline is centre + S (cos, sin).
    """

    centre: Array
    shape: Array

    def __len__(self) -> int:
        return len(self.centre)

    def take(self, rows: Array) -> Discs:
        """Select some of them."""
        return Discs(self.centre[rows], self.shape[rows])

    @property
    def radius(self) -> Array:
        """Geometric mean (N,) of the half-axes, px."""
        return np.sqrt(np.abs(np.linalg.det(self.shape)))

    def scaled(self, factor: float) -> Discs:
        """Convert to the pixels of a picture that is `factor` times as large."""
        return Discs((self.centre + 0.5) * factor - 0.5, self.shape * factor)


def dark_outlines(smooth: Array) -> Iterator[Array]:
    """Outlines (K, 1, 2) of regions darker than their surroundings in a uint8 picture, for each window size."""
    for part in WINDOWS:
        size = 2 * (max(max(smooth.shape) // part, LEAST_WINDOW) // 2) + 1
        mean, inverse = cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY_INV
        dark = cv2.adaptiveThreshold(smooth, 255, mean, inverse, size, THRESHOLD)
        yield from cv2.findContours(dark, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)[0]


def find_discs(gray: Array) -> Discs:
    """Dark ellipses of a grey uint8 picture, from contours under adaptive thresholds of three sizes."""
    smooth = cv2.GaussianBlur(gray, (0, 0), BLUR)
    found = [e for e in map(ellipse_of, dark_outlines(smooth)) if e is not None]
    if not found:
        return Discs(np.zeros((0, 2)), np.zeros((0, 2, 2)))
    discs = Discs(np.array([c for c, _ in found]), np.array([s for _, s in found]))
    return distinct(discs.take(_dark_inside(smooth, discs)))


def ellipse_of(outline: Array) -> tuple[Array, Array] | None:
    """The centre and shape of a closed outline, from its moments; None if it is not an ellipse."""
    if len(outline) < LEAST_OUTLINE:
        return None
    m = cv2.moments(outline)
    area = m["m00"]
    if area < LEAST_AREA:
        return None
    # the outline runs through pixel centres; the disc reaches half a pixel farther
    second = np.array([[m["mu20"], m["mu11"]], [m["mu11"], m["mu02"]]]) / area
    values, vectors = np.linalg.eigh(second)
    if values[0] <= 0 or values[1] > MOST_SLENDER**2 * values[0]:
        return None
    axes = 2 * np.sqrt(values)
    if abs(np.pi * axes[0] * axes[1] / area - 1) > AREA_TOLERANCE:
        return None
    centre = np.array([m["m10"], m["m01"]]) / area
    offset = outline[:, 0] - centre
    radius = np.linalg.norm(offset @ vectors / axes, axis=1)
    if np.sqrt(np.mean((radius - 1) ** 2)) > ROUND + PIXEL / axes[0]:
        return None
    return centre, (vectors * (axes + 0.5)) @ vectors.T


def _dark_inside(gray: Array, discs: Discs) -> Array:
    """Mask of the discs that are darker in the middle than all around."""
    if not len(discs):
        return np.zeros(0, bool)
    angle = np.arange(8) * np.pi / 4
    ring = np.stack([np.cos(angle), np.sin(angle)], -1)
    around = discs.centre[:, None] + np.einsum("nij,kj->nki", discs.shape, AROUND * ring)
    at = np.concatenate([discs.centre[:, None], around], 1).astype(np.float32)
    value = cv2.remap(gray, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    value = value.astype(float)
    return (
        np.sort(value[:, 1:], 1)[:, 1] > value[:, 0] + THRESHOLD
    )  # one of the eight may lie on another object


def distinct(discs: Discs) -> Discs:
    """Remove duplicates: of several outlines with one centre keep the largest, which is that of the disc."""
    size = discs.radius
    order = np.argsort(-size)[:MOST_DISCS]
    discs, size = discs.take(order), size[order]
    if not len(discs):
        return discs
    gone = np.zeros(len(discs), bool)
    for i, close in enumerate(Neighbours(discs.centre).within(CONCENTRIC * size)):
        if not gone[i]:
            inner = close[close > i]
            apart = np.linalg.norm(discs.centre[inner] - discs.centre[i], axis=1)
            gone[inner[apart < CONCENTRIC * size[inner]]] = True
    return discs.take(~gone)


def links(discs: Discs) -> tuple[Array, Array]:
    """The links between neighbouring discs; see `grid.neighbours`.

    In the metric of a disc its neighbours are the nearest discs, at right angles: the mean of exp(4 i angle) over
    them gives the directions of the cross; diagonals have the opposite sign. A disc farther away than the nearest,
    in the metric of both discs, lies beyond a hidden disc or belongs to another board.
    """
    inverse = np.linalg.inv(discs.shape)
    near = Neighbours(discs.centre).query(discs.centre, k=min(NEAREST + 1, len(discs)))[1][:, 1:]
    step = discs.centre[near] - discs.centre[:, None]
    flat = np.einsum("nij,nkj->nki", inverse, step)  # without the foreshortening
    length = np.linalg.norm(flat, axis=2)
    like = np.abs(np.log(discs.radius[near] / discs.radius[:, None])) < np.log(SPREAD)
    length[~like] = np.inf
    nearest = length.min(
        1
    )  # infinite where none is of like size; `neighbours` looks at the same ones and links none
    closest = length < SAME * nearest[:, None]
    angle = np.arctan2(flat[..., 1], flat[..., 0])
    first = np.angle((closest * np.exp(4j * angle)).sum(1)) / 4
    turned = first[:, None] + np.arange(4) * np.pi / 2
    rays = np.einsum("nij,nkj->nki", discs.shape, np.stack([np.cos(turned), np.sin(turned)], -1))
    rays /= np.linalg.norm(rays, axis=2, keepdims=True)

    def near_enough(i: Array, _: Array, j: Array) -> Array:
        apart = discs.centre[j] - discs.centre[i]
        lengths = (
            np.linalg.norm(np.einsum("nij,nj->ni", inverse[k], apart), axis=1) / nearest[k] for k in (i, j)
        )
        return np.sqrt(np.multiply(*lengths)) < SAME

    marks = Marks(discs.centre, rays, discs.radius, SPREAD, alternating=False, closed=False)
    return neighbours(marks, near_enough)
