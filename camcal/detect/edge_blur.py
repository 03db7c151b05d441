"""The blur of the edges of a grid of squares, estimated before any fit."""

from __future__ import annotations

import cv2
import numpy as np

from camcal.detect.lattice import Lattice
from camcal.geometry.numbers import median

Array = np.ndarray

SAMPLES = 33  #: across an edge; an edge lies at random between samples, so means over many are unbiased
ACROSS = 0.45  #: of a square, to each side of an edge: the next parallel edges are farther away
LINEAR = 1 / 6  #: px²; the variance that linear interpolation adds, t (1 - t) on average
MOST_EDGES = 400  #: edges of one kind that are examined; a board has some hundred
ENDS = 5  #: samples at each end from which the levels of the squares are taken
LEAST_STEP = 0.1  #: of the median step from black to white; a fainter edge is occluded


def edge_blur(gray: Array, lattice: Lattice) -> tuple[float, float]:
    """Standard deviation of the blur across the edges along the columns and along the rows, px.

    Across an edge blurred by sigma, the grey values normalised to 0 and 1 at the two ends are Φ(x / sigma), and
    ∫ Φ (1 - Φ) dx = sigma / √π wherever the edge is. The result is the median over all edges between neighbouring
    corners; 0 if there is none, or if the blur cannot be distinguished from noise.

    Parameters
    ----------
    gray : (height, width) array
    lattice : Lattice
        Corners, in px of `gray`.
    """
    uv, steps = lattice.uv, lattice.steps()
    along_columns = _blurs(gray, uv[:, :-1], uv[:, 1:], steps[:, :-1, 1], steps[:, 1:, 1])
    along_rows = _blurs(gray, uv[:-1], uv[1:], steps[:-1, :, 0], steps[1:, :, 0])
    return along_columns, along_rows


def _blurs(gray: Array, start: Array, end: Array, across_start: Array, across_end: Array) -> float:
    """The median blur of edges between corners (..., 2), given the steps across the adjacent squares at both ends."""
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
