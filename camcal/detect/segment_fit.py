"""Sub-pixel line segments: a straight line fitted to the maxima of the gradient across each segment.

A segment detector groups pixels of one gradient direction and takes their middle, which depends on the extent of the
group. The maxima of the gradient across a segment (as for edges: Canny 1986, interpolated by a parabola) do not depend
on it. A line is fitted to them with weights that decrease with their distance from it (Tukey's biweight), so that
corners, crossings and neighbouring edges have no influence.
"""

from __future__ import annotations

import cv2
import numpy as np

from camcal.least_squares.scales import MAD, TUKEY

Array = np.ndarray

#: px; sigma of the Gaussian derivatives
BLUR = 1.0
#: px; range beside the segment in which a maximum is searched: twice the error of the ends, about one
REACH = 2.5
STEP = 0.25  #: px between samples across a segment
#: px that are omitted at either end, where an edge is rounded near a corner
TRIM = 2.0
#: least number of maxima of a segment: with fewer the detector's ends are kept
LEAST = 8
ROUNDS = 2  #: the second samples at right angles to the line found by the first
WEIGHTINGS = 6  #: reweightings of the fit of a line
#: px; lower limit of the standard deviation of maxima: samples every 0.25 px, and 8 bits
FINEST = 0.02


def refined(gray: Array, ends: Array) -> Array:
    """Refine the end points (N, 2, 2), px, of segments: those of the lines fitted to the edges under them."""
    smooth = cv2.GaussianBlur(gray.astype(np.float32), (0, 0), BLUR)
    gradient = cv2.Sobel(smooth, cv2.CV_32F, 1, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 1)
    out = np.array(ends, float)
    for i, segment in enumerate(out):
        for _ in range(ROUNDS):
            moved = _moved(gradient, segment)
            if moved is None:
                break
            out[i] = segment = moved
    return out


def _moved(gradient: tuple[Array, Array], segment: Array) -> Array | None:
    length = float(np.linalg.norm(segment[1] - segment[0]))
    along = (segment[1] - segment[0]) / length
    across = np.array([-along[1], along[0]])
    place = np.arange(TRIM, length - TRIM)
    offsets = np.arange(-REACH, REACH + STEP / 2, STEP)
    at = (segment[0] + place[:, None] * along)[:, None] + offsets[:, None] * across
    u, v = at[..., 0].astype(np.float32), at[..., 1].astype(np.float32)
    gx, gy = (cv2.remap(g, u, v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE) for g in gradient)
    slope = gx * across[0] + gy * across[1]
    # edges of one polarity: that of most of the segment's own pixels
    slope = slope * (1 if np.median(slope[:, len(offsets) // 2]) >= 0 else -1)
    top = slope.argmax(1)
    rows = np.flatnonzero((top > 0) & (top < len(offsets) - 1))
    if len(rows) < LEAST:
        return None
    top = top[rows]
    before, peak, after = (slope[rows, top + k].astype(float) for k in (-1, 0, 1))
    off = offsets[top] + 0.5 * STEP * (before - after) / np.minimum(before - 2 * peak + after, -1e-9)
    middle, turn = _line(place[rows] - length / 2, off, peak**2)
    return np.asarray(segment + np.outer(middle + turn * np.array([-0.5, 0.5]) * length, across))


def _line(place: Array, off: Array, strength: Array) -> tuple[float, float]:
    """Offset at 0 and slope of `off` (N,) over `place` (N,); the noise of a maximum decreases with its strength."""
    columns = np.stack([np.ones(len(place)), place], 1)
    weight = strength
    for _ in range(WEIGHTINGS):
        scaled = columns * weight[:, None]
        found = np.linalg.lstsq(scaled.T @ columns, scaled.T @ off, rcond=None)[0]
        rest = off - columns @ found
        sigma = MAD * float(np.median(np.abs(rest))) + FINEST
        weight = strength * np.maximum(1 - (rest / (TUKEY * sigma)) ** 2, 0) ** 2
    return float(found[0]), float(found[1])
