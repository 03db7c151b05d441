"""Where a picture may show a corner of four squares: saddles of the grey value with four sectors.

A saddle has a Hessian of negative determinant; the ring of pixels around it changes between bright and dark
exactly four times, opposite sectors alike. The second test is that of Bennett & Lasenby, ChESS (2014),
taken here as a count of sign changes, which also yields the directions of the two edges.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial import cKDTree

Array = np.ndarray

BLUR = 1.2  #: px; of the picture before its second derivatives
NEIGHBOURHOOD = 5  #: px; one candidate in each such square
MOST = 2500  #: candidates that are looked at more closely, the strongest first
TWINS = 3.5  #: px; candidates so close together are one corner
LEAST_CONTRAST = 1.5  #: grey levels of 255 by which a sector differs from the mean
RINGS = (3.0, 4.5, 7.0)  #: px; radii of the rings, the innermost must always fit between two corners
SAMPLES = 32  #: points on a ring


@dataclass(frozen=True)
class Candidates:
    """Corners that a picture may show.

    Attributes
    ----------
    xy : (N, 2) array
        px.
    rays : (N, 4) array
        Directions of the four half-edges, radians, ascending (clockwise in the picture); the sector that
        follows an even ray is bright.
    contrast : (N,) array
        Half the difference of bright and dark, grey levels.
    weak : (M, 2) array
        All saddles, those without four sectors included, px.
    """

    xy: Array
    rays: Array
    contrast: Array
    weak: Array

    def __len__(self) -> int:
        return len(self.xy)


def find_candidates(gray: Array) -> Candidates:
    """Saddles with four alternating sectors of a grey float32 picture (values of 0 to 255)."""
    smooth = cv2.GaussianBlur(gray, (0, 0), BLUR)
    weak = _saddles(smooth)
    rays = np.zeros((len(weak), 4))
    contrast = np.zeros(len(weak))
    left = np.arange(len(weak))
    for radius in RINGS:  # the directions come from the widest ring that still shows four sectors
        good, angles, difference = _sectors(smooth, weak[left], radius)
        left = left[good]
        rays[left], contrast[left] = angles, difference
    good = np.flatnonzero(contrast > LEAST_CONTRAST)
    good = good[_single(weak[good], contrast[good])]
    return Candidates(weak[good], rays[good], contrast[good], weak)


def _single(xy: Array, contrast: Array) -> Array:
    """Mask (N,) that leaves the best of candidates so close that they are one corner, split by noise or smear."""
    kept = np.ones(len(xy), bool)
    if len(xy):
        pairs = cKDTree(xy).query_pairs(TWINS, output_type="ndarray")
        first_better = contrast[pairs[:, 0]] >= contrast[pairs[:, 1]]
        kept[np.where(first_better, pairs[:, 1], pairs[:, 0])] = False
    return kept


def _saddles(smooth: Array) -> Array:
    """Sub-pixel places (N, 2) of the strongest maxima of -det(Hessian)."""
    one, second, first = (np.array(k, np.float32) for k in ([1], [1, -2, 1], [-0.5, 0, 0.5]))
    xx = cv2.sepFilter2D(smooth, cv2.CV_32F, second, one)
    yy = cv2.sepFilter2D(smooth, cv2.CV_32F, one, second)
    xy = cv2.sepFilter2D(smooth, cv2.CV_32F, first, first)
    strength = xy * xy - xx * yy
    # a corner of half-contrast b under a blur s has |Ixy| = (2/pi) b / s^2 at its centre
    least = (0.25 * LEAST_CONTRAST) ** 2
    peak = cv2.dilate(strength, np.ones((NEIGHBOURHOOD, NEIGHBOURHOOD), np.uint8))
    rows, cols = np.nonzero((strength >= peak) & (strength > least))
    inside = (np.minimum(rows, cols) >= 4) & (rows < smooth.shape[0] - 4) & (cols < smooth.shape[1] - 4)
    rows, cols = rows[inside], cols[inside]
    value = strength[rows, cols]
    if len(rows) > MOST:
        strongest = np.argpartition(value, -MOST)[-MOST:]
        rows, cols, value = rows[strongest], cols[strongest], value[strongest]
    gx = 0.5 * (smooth[rows, cols + 1] - smooth[rows, cols - 1])
    gy = 0.5 * (smooth[rows + 1, cols] - smooth[rows - 1, cols])
    a, b, c = xx[rows, cols], xy[rows, cols], yy[rows, cols]
    step = np.stack([(c * gx - b * gy) / value, (a * gy - b * gx) / value], -1)  # -H^-1 g with det H = -value
    return np.stack([cols, rows], -1) + np.clip(step, -1.5, 1.5)


def _sectors(smooth: Array, xy: Array, radius: float) -> tuple[Array, Array, Array]:
    """Which points see four alternating sectors on a ring: mask (N,), rays (K, 4), contrast (K,)."""
    theta = np.arange(SAMPLES) * (2 * np.pi / SAMPLES)
    ring = radius * np.stack([np.cos(theta), np.sin(theta)], -1)
    at = (xy[:, None] + ring).astype(np.float32)
    if not len(xy):
        return np.zeros(0, bool), np.zeros((0, 4)), np.zeros(0)
    values = cv2.remap(smooth, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    high, low = values.max(1), values.min(1)
    values = values - (0.5 * (high + low))[:, None]
    bright = values > 0
    changes = bright != np.roll(bright, -1, 1)
    good = changes.sum(1) == 4
    good &= (values * np.roll(values, SAMPLES // 2, 1)).sum(1) > 0.3 * (values**2).sum(1)
    index = np.nonzero(changes[good])[1].reshape(-1, 4)
    rows = np.arange(len(index))[:, None]
    before, after = values[good][rows, index], values[good][rows, (index + 1) % SAMPLES]
    rays = (index + before / (before - after)) * (2 * np.pi / SAMPLES)
    dark_first = ~bright[good][rows[:, 0], (index[:, 0] + 1) % SAMPLES]
    rays[dark_first] = np.roll(rays[dark_first], -1, 1)  # let the sector behind ray 0 be bright
    width = np.diff(np.c_[rays, rays[:, 0]], axis=1) % (2 * np.pi)
    straight = np.abs((width[:, :2] + width[:, 1:3]) - np.pi).max(1) < 0.6
    wide = width.min(1) > 0.2
    kept = np.flatnonzero(good)[straight & wide]
    good = np.zeros(len(xy), bool)
    good[kept] = True
    return good, rays[straight & wide], 0.5 * (high - low)[kept]
