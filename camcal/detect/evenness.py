"""Regularity of a grid: its points fit a regular grid on a plane, and its contrast is as uniform as that of a print."""

from __future__ import annotations

import numpy as np

from camcal.geometry import homography
from camcal.geometry.neighbours import Neighbours

Array = np.ndarray

BLOCK = 3  #: points along each side of a block: of 2x2 points a homography leaves nothing
LEAST_POINTS = 6  #: of the nine of a block; a homography needs four
AROUND = 4  #: neighbours with which the contrast of a disc or square is compared
#: of the contrast; discs and squares of 28 real pictures have at most .028, even with noise of 5 grey levels; windows
#: of 6 rendered houses have at least .086
UNLIKE_NEIGHBOURS = 0.05


def unevenness(uv: Array) -> float:
    """The deviation of blocks of 3x3 points from a homography of a square grid.

    Parameters
    ----------
    uv : (rows, columns, 2) array
        px; NaN where a point is missing.

    Returns
    -------
    float
        Median over the blocks of the standard deviation of their points, relative to the median step; 0 if
        no block has enough points.
    """
    if min(uv.shape[:2]) < BLOCK:
        return 0.0
    windows = np.lib.stride_tricks.sliding_window_view(uv, (BLOCK, BLOCK), axis=(0, 1))
    blocks = np.moveaxis(windows, 2, -1).reshape(-1, BLOCK * BLOCK, 2)
    known = np.isfinite(blocks[..., 0])
    enough = known.sum(1) >= LEAST_POINTS
    if not enough.any():
        return 0.0
    blocks, known = blocks[enough], known[enough]
    square = np.stack(np.meshgrid(*[np.arange(float(BLOCK))] * 2), -1).reshape(1, -1, 2)
    plane = np.broadcast_to(square, blocks.shape)
    cost = homography.solve(plane, np.where(known[..., None], blocks, 0.0), known.astype(float))[2]
    steps = np.concatenate([np.linalg.norm(np.diff(uv, axis=a), axis=-1).ravel() for a in (0, 1)])
    freedom = 2 * known.sum(1) - 8
    return float(np.median(np.sqrt(cost / freedom)) / np.nanmedian(steps))


def unevenly_dark(contrast: Array, centre: Array) -> bool:
    """Return whether discs or squares differ from their neighbours in contrast, as windows do and printed ones do not.

    Shading changes the contrast of neighbours together; the edge of a shadow or a reflection affects only a few.

    Parameters
    ----------
    contrast : (K,) array
        How much darker each is than its surroundings, grey levels.
    centre : (K, 2) array
        px.
    """
    near = Neighbours(centre).query(centre, k=min(AROUND + 1, len(centre)))[1][:, 1:]
    usual = np.median(contrast[near], 1)
    return bool(np.median(np.abs(contrast - usual)) > UNLIKE_NEIGHBOURS * np.median(contrast))
