"""The blur of the edges of a grid of squares, estimated before any fit."""

from __future__ import annotations

import cv2
import numpy as np

from camcal.detect.lattice import Lattice
from camcal.detect.ranks import median

Array = np.ndarray

SAMPLES = 33  #: across an edge; the place of an edge between them is random, and means of many edges unbiased
ACROSS = 0.45  #: of a square, to each side of an edge: the next edges are half a square farther
LINEAR = 1 / 6  #: px²; the variance of linear interpolation, t (1 - t) on average
MOST_EDGES = 400  #: of one kind that are examined; a board has some hundred
ENDS = 5  #: samples at each end that show the colours of the squares
LEAST_STEP = 0.1  #: of the median step from black to white; a fainter edge is covered


def edge_blur(gray: Array, lattice: Lattice) -> tuple[float, float]:
    """Standard deviation of the blur across the edges along the columns and along the rows, px.

    Across an edge blurred by sigma the grey values, brought to 0 and 1 at both ends, are Φ(x / sigma), wherever the
    edge is, and ∫ Φ (1 - Φ) dx = sigma / √π. The median over all edges between neighbouring corners is taken; 0
    where there is none, or no blur beside the noise.

    Parameters
    ----------
    gray : (height, width) array
    lattice : Lattice
        Corners, px of that picture.
    """
    uv, steps = lattice.uv, lattice.steps()
    along_columns = _blurs(gray, uv[:, :-1], uv[:, 1:], steps[:, :-1, 1], steps[:, 1:, 1])
    along_rows = _blurs(gray, uv[:-1], uv[1:], steps[:-1, :, 0], steps[1:, :, 0])
    return along_columns, along_rows


def _blurs(gray: Array, start: Array, end: Array, across_start: Array, across_end: Array) -> float:
    """The median blur of edges between corners (..., 2), with the steps to the squares' other sides at both ends."""
    edge, across = end - start, 0.5 * (across_start + across_end)
    known = (np.linalg.norm(edge, axis=-1) > 0) & np.isfinite(across).all(-1)
    known &= np.arange(known.size).reshape(known.shape) % (1 + known.size // MOST_EDGES) == 0
    middle, edge, across = (0.5 * (start + end))[known], edge[known], across[known]
    if not len(edge):
        return 0.0
    position = np.linspace(-ACROSS, ACROSS, SAMPLES)
    at = (middle[:, None] + position[:, None] * across[:, None]).astype(np.float32)
    value = cv2.remap(gray, at, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(float)
    low, high = value[:, :ENDS].mean(1), value[:, -ENDS:].mean(1)
    step = high - low
    clear = np.abs(step) > LEAST_STEP * median(np.abs(step))
    share = (value[clear] - low[clear, None]) / step[clear, None]
    width = np.abs(edge[:, 0] * across[:, 1] - edge[:, 1] * across[:, 0]) / np.linalg.norm(edge, axis=1)
    integral = (share * (1 - share)).mean(1) * 2 * ACROSS * width[clear]
    if not clear.any():
        return 0.0
    blur = max(float(np.sqrt(np.pi) * median(integral)), 0.0)
    return float(np.sqrt(max(blur**2 - LINEAR, 0.0)))
