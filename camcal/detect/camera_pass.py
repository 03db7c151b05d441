"""The second pass of photogrammetry: corners fitted again on edges that a camera predicts.

The camera and the pose of a view tell where each pixel lies on the board; there the edges are straight,
whatever the lens. Only the shape of the edges is taken from the camera, not where the corner is: the fit
stays a measurement.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from camcal.data.observations import View
from camcal.detect import saddle

Array = np.ndarray

STEP = 0.5  #: px; of the differences that give the board's directions in the picture


def refine_with_camera(
    gray: Array,
    view: View,
    board_from_pixel: Callable[[Array], Array],
    cell: float,
    half: float | Array = saddle.WIDER_HALF,
) -> tuple[View, float]:
    """Fit the corners of a view again.

    Parameters
    ----------
    gray : (height, width) uint8 or uint16 array
    view : View
        With the corners found so far.
    board_from_pixel : callable
        From pixels (..., 2) to coordinates (..., 2) on the board, in the unit of the board; NaN where the
        ray misses it.
    cell : float
        Side of a square in that unit.
    half : float or (N,) array
        Half-width of the windows, of a square; see `saddle.wider_halves`.

    Returns
    -------
    view : View
        With new `uv` and `sigma`; a corner that cannot be fitted this way keeps what it had.
    moved : float
        Root mean square of the corners' moves, px; 0 where none was fitted.
    """
    sides, known = _sides(view.uv, board_from_pixel, cell)
    rows = np.flatnonzero(known)
    first = saddle.refine(gray, view.uv[rows], sides[rows])
    rows, first = rows[first.good], first.take(first.good)
    if not len(rows):
        return view, 0.0
    share = np.broadcast_to(half, len(view.uv))[rows]
    second = saddle.sharpen(gray, first, sides[rows], board_from_pixel, share)
    rows, second = rows[second.good], second.take(second.good)
    uv = view.uv.copy()
    uv[rows] = second.uv
    sigma = None if view.sigma is None else view.sigma.copy()
    if sigma is not None:
        sigma[rows] = second.sigma
    elif len(rows) == len(view.uv):
        sigma = second.sigma
    moved = np.sqrt(((second.uv - view.uv[rows]) ** 2).sum(1).mean()) if len(rows) else 0.0
    return View(view.id, view.xyz, uv, sigma, view.point_ids), float(moved)


def _sides(uv: Array, board_from_pixel: Callable[[Array], Array], cell: float) -> tuple[Array, Array]:
    """Steps (N, 2, 2) of one square along the board's axes, px, and where they are known (N,)."""
    cross = STEP * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]], float)
    board = board_from_pixel(uv[:, None] + cross)
    derivative = np.stack([board[:, 0] - board[:, 1], board[:, 2] - board[:, 3]], -1) / (2 * STEP * cell)
    area = derivative[:, 0, 0] * derivative[:, 1, 1] - derivative[:, 0, 1] * derivative[:, 1, 0]
    known = np.isfinite(area) & (np.abs(area) > 1e-12)
    derivative = np.where(known[:, None, None], derivative, np.eye(2))
    return np.linalg.inv(derivative).transpose(0, 2, 1), known
