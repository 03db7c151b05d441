"""Whether the squares of a checkerboard contain markers, including ones too small to read."""

from __future__ import annotations

import cv2
import numpy as np

from camcal.detect.targets.base import Detection
from camcal.geometry.homography import within_quads
from camcal.geometry.numbers import median

Array = np.ndarray

SAMPLES = 12  #: along each side of a square
MIDDLE = 0.15  #: of a square; samples nearer to its edges are omitted because of blur and corner errors
#: of the difference of black and white: median over the squares of one colour. Plain squares of ten real sets
#: have at most 0.06, markers of 7 px with a blur of 2 px still 0.11; a logo or OpenCV's three dots occupy few squares
LEAST_SPREAD = 0.08
#: ratio to the spread of the other colour. Blur and glare affect the middle of both: up to 1.4 in the same sets where
#: the spread is above 0.05; those markers have 1.9
LEAST_RATIO = 1.6
LEAST_SQUARES = 4  #: of each colour; single squares would decide the median of fewer
LEAST_SIDE = 6.0  #: px; smaller squares have no middle that is free of blur


def squares_hold_marks(gray: Array, found: Detection, size: tuple[int, int]) -> bool:
    """Return whether most squares of one colour are not uniform.

    Parameters
    ----------
    gray : (height, width) array
    found : Detection
        Of a checkerboard.
    size : (columns, rows)
        Inner corners.
    """
    if found.info.get("square_px", 0.0) < LEAST_SIDE:
        return False
    uv = np.full((size[0] * size[1], 2), np.nan)
    uv[found.point_ids] = found.uv
    grid = uv.reshape(size[1], size[0], 2)
    corners = np.stack([grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]], 2)
    row, column = np.nonzero(np.isfinite(corners).all((2, 3)))
    dark = (row + column) % 2 == 0
    if min(dark.sum(), (~dark).sum()) < LEAST_SQUARES:
        return False
    middle, spread = _middles(gray, corners[row, column])
    contrast = abs(median(middle[dark]) - median(middle[~dark]))
    less, more = sorted((median(spread[dark]), median(spread[~dark])))
    return more > LEAST_SPREAD * max(contrast, 1.0) and more > LEAST_RATIO * less


def _middles(gray: Array, corners: Array) -> tuple[Array, Array]:
    """The median and standard deviation of the grey values in the middle of squares (K, 4, 2)."""
    at = MIDDLE + (1 - 2 * MIDDLE) * (np.arange(SAMPLES) + 0.5) / SAMPLES
    low = np.maximum(
        np.floor(corners.min((0, 1))).astype(int) - 1, 0
    )  # only the part with the board, if the picture is large
    high = np.ceil(corners.max((0, 1))).astype(int) + 2
    part = gray[low[1] : high[1], low[0] : high[0]].astype(np.float32)
    u, v = (a.reshape(len(corners), -1).astype(np.float32) for a in within_quads(corners - low, at))
    value = cv2.remap(part, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return median(value, 1), value.std(1)
