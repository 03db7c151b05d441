"""Segments of a picture to sub-pixel accuracy: the maxima of the gradient across each of them, and a straight line.

A detector of segments groups pixels of one gradient direction and takes their middle, which depends on where the
group ends. The maxima of the gradient across a segment (as for edges: Canny 1986, the maximum by a parabola) do not; a
line is fitted to them with weights that fall with their distance from it (Tukey's biweight), so that corners,
crossings and neighbouring edges under the segment have no say.
"""

from __future__ import annotations

import cv2
import numpy as np

from camcal.least_squares.scales import MAD, TUKEY

Array = np.ndarray

#: px; of the Gaussian under the derivatives
BLUR = 1.0
#: px; how far beside the segment a maximum is looked for: ends are off by up to about one, and twice that is tried
REACH = 2.5
STEP = 0.25  #: px between samples across a segment
#: px that are left out at either end, where an edge bends round a corner
TRIM = 2.0
#: maxima of a segment at least: with fewer the detector's ends stay
LEAST = 8
ROUNDS = 2  #: the second samples at right angles to the line that the first has found
WEIGHTINGS = 6  #: of the fit of a line
#: px; the standard deviation of maxima is no less: samples every 0.25 px and 8 bits
FINEST = 0.02


def refined(gray: Array, ends: Array) -> Array:
    """End points (N, 2, 2), px, of the lines nearest to the edges under segments with the ends given."""
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
    # edges of one sense: that of most of the segment's own pixels
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
    """Offset at 0 and slope of off (N,) over place (N,); the variance of a maximum is that of grey by its strength."""
    columns = np.stack([np.ones(len(place)), place], 1)
    weight = strength
    for _ in range(WEIGHTINGS):
        scaled = columns * weight[:, None]
        found = np.linalg.lstsq(scaled.T @ columns, scaled.T @ off, rcond=None)[0]
        rest = off - columns @ found
        sigma = MAD * float(np.median(np.abs(rest))) + FINEST
        weight = strength * np.maximum(1 - (rest / (TUKEY * sigma)) ** 2, 0) ** 2
    return float(found[0]), float(found[1])
