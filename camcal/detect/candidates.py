"""Candidates for corners where four squares meet: saddles of the grey values with four sectors.

A saddle has a Hessian of negative determinant; the ring of pixels around it changes between bright and dark
exactly four times, and opposite sectors are alike. The second test is that of Bennett & Lasenby, ChESS (2014),
implemented here as a count of sign changes, which also yields the directions of the two edges.
"""

from __future__ import annotations

import cv2
import numpy as np

from camcal.detect.grid import Marks
from camcal.geometry.neighbours import Neighbours
from camcal.records import dataclass

Array = np.ndarray

BLUR = 1.2  #: px; blur of the picture before its second derivatives are taken
NEIGHBOURHOOD = 5  #: px; one candidate in each such square
MOST = 2500  #: candidates examined, the strongest first: a board of 45x45 and as many others
SINGLE = 3.5  #: px; candidates this close together are one corner, as rings of 3 px need squares of 4 px
LEAST_CONTRAST = 0.9  #: grey levels of 255 by which a sector differs from the mean; rounding alone gives 0.2
RINGS = (3.0, 4.5, 7.0)  #: px; radii of the rings, the innermost must always fit between two corners
MARGIN = int(RINGS[0]) + 1  #: px to the border: the innermost ring and 1 px for interpolation
#: px along each axis, largest distance from the pixel of a maximum to the interpolated maximum; at .5 px corners of
#: squares of 4 px are lost, from .7 to 8 px none
MOST_STEP = 1.5
SPACING = 1.5  #: px; largest distance of samples on a ring, not much more than the blur
OPPOSITE = 0.3  #: least correlation of opposite halves of a ring
LEAST_SECTOR = 0.2  #: rad; a square seen at an angle of 80 degrees is as narrow
MOST_BEND = 0.6  #: rad; by which the sum of two neighbouring sectors may differ from half a turn
SPREAD = 4.0  #: ratio of the contrasts of neighbours: a shadow across the board


@dataclass(frozen=True)
class Candidates:
    """Candidate corners of a picture.

    Attributes
    ----------
    marks : Marks
        Their rays are the four half-edges; the sector after an even ray is bright. Their size is half the
        difference between bright and dark, grey levels.
    weak : (M, 2) array
        All saddles, including those without four sectors, px.
    """

    marks: Marks
    weak: Array

    def __len__(self) -> int:
        return len(self.marks.xy)


def find_candidates(gray: Array) -> Candidates:
    """Saddles with four alternating sectors of a grey float32 picture (values of 0 to 255)."""
    smooth = cv2.GaussianBlur(gray, (0, 0), BLUR)
    weak = _saddles(smooth)
    rays, contrast = np.zeros((len(weak), 4)), np.zeros(len(weak))
    left = np.arange(len(weak))
    for radius in RINGS:  # the directions come from the widest ring that still shows four sectors
        good, angles, difference = _sectors(smooth, weak[left], radius)
        left = left[good]
        rays[left], contrast[left] = angles, difference
    good = np.flatnonzero(contrast > LEAST_CONTRAST)
    good = good[_single(weak[good], contrast[good])]
    directions = np.stack([np.cos(rays[good]), np.sin(rays[good])], -1)
    marks = Marks(weak[good], directions, contrast[good], SPREAD, alternating=True, closed=True)
    return Candidates(marks, weak)


def _single(xy: Array, contrast: Array) -> Array:
    """Mask (N,) that keeps the best of several candidates at one corner, which noise or motion has split."""
    kept = np.ones(len(xy), bool)
    if len(xy):
        pairs = Neighbours(xy).pairs(SINGLE)
        first_better = contrast[pairs[:, 0]] >= contrast[pairs[:, 1]]
        kept[np.where(first_better, pairs[:, 1], pairs[:, 0])] = False
    return kept


def _saddles(smooth: Array) -> Array:
    """Sub-pixel positions (N, 2) of the strongest maxima of -det(Hessian)."""
    one, second, first = (np.array(k, np.float32) for k in ([1], [1, -2, 1], [-0.5, 0, 0.5]))
    xx = cv2.sepFilter2D(smooth, cv2.CV_32F, second, one)
    yy = cv2.sepFilter2D(smooth, cv2.CV_32F, one, second)
    xy = cv2.sepFilter2D(smooth, cv2.CV_32F, first, first)
    strength = cv2.subtract(cv2.multiply(xy, xy), cv2.multiply(xx, yy))
    # a corner of half-contrast b under a blur s has |Ixy| = (2/pi) b / s^2 at its centre: with s^2 = 3, b / 5
    least = (0.2 * LEAST_CONTRAST) ** 2
    peak = cv2.dilate(strength, np.ones((NEIGHBOURHOOD, NEIGHBOURHOOD), np.uint8))
    height, width = smooth.shape
    index = np.flatnonzero(strength >= np.maximum(peak, np.float32(least)))
    rows, cols = np.divmod(index, width)
    inside = (np.minimum(rows, cols) >= MARGIN) & (rows < height - MARGIN) & (cols < width - MARGIN)
    rows, cols = rows[inside], cols[inside]
    value = strength[rows, cols]
    if len(rows) > MOST:
        strongest = np.argpartition(value, -MOST)[-MOST:]
        rows, cols, value = rows[strongest], cols[strongest], value[strongest]
    gx = 0.5 * (smooth[rows, cols + 1] - smooth[rows, cols - 1])
    gy = 0.5 * (smooth[rows + 1, cols] - smooth[rows - 1, cols])
    a, b, c = xx[rows, cols], xy[rows, cols], yy[rows, cols]
    step = np.stack([(c * gx - b * gy) / value, (a * gy - b * gx) / value], -1)  # -H^-1 g with det H = -value
    return np.stack([cols, rows], -1) + np.clip(step, -MOST_STEP, MOST_STEP)


def _sectors(smooth: Array, xy: Array, radius: float) -> tuple[Array, Array, Array]:
    """The points with four alternating sectors on a ring: indices (K,), directions (K, 4), contrast (K,).

    The directions are those of the four edges, radians, ascending (clockwise in the picture); the sector that
    follows the first is bright.
    """
    samples = 8 * int(np.ceil(2 * np.pi * radius / SPACING / 8))
    if not len(xy):
        return np.zeros(0, int), np.zeros((0, 4)), np.zeros(0)
    theta = np.arange(samples, dtype=np.float32) * np.float32(2 * np.pi / samples)
    x, y = (
        xy[:, i].astype(np.float32) + np.float32(radius) * f(theta)[:, None]
        for i, f in enumerate((np.cos, np.sin))
    )
    values = cv2.remap(smooth, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)  # (samples, N)
    high, low = values.max(0), values.min(0)
    values -= 0.5 * (high + low)
    changes = np.signbit(values)
    changes = changes != np.concatenate([changes[1:], changes[:1]])
    four = np.flatnonzero(np.add.reduce(changes, 0, dtype=np.uint8) == 4)
    values = values[:, four]
    opposite = 2 * (values[: samples // 2] * values[samples // 2 :]).sum(0)
    alike = opposite > OPPOSITE * (values * values).sum(0)
    four, values = four[alike], values[:, alike].T
    index = np.nonzero(changes[:, four].T)[1].reshape(-1, 4)
    rows = np.arange(len(four))[:, None]
    before, after = values[rows, index], values[rows, (index + 1) % samples]
    rays = (index + before / (before - after)) * (2 * np.pi / samples)
    dark_first = after[:, 0] < 0
    rays[dark_first] = np.roll(rays[dark_first], -1, 1)  # make the sector after ray 0 bright
    width = np.diff(np.c_[rays, rays[:, 0]], axis=1) % (2 * np.pi)
    kept = np.abs(width[:, :2] + width[:, 1:3] - np.pi).max(1) < MOST_BEND
    kept &= width.min(1) > LEAST_SECTOR
    return four[kept], rays[kept], 0.5 * (high - low)[four[kept]]
