"""The second pass: corners fitted again, with the shape of their edges predicted by the camera.

The camera and the pose of a view map each pixel to the board, where the edges are straight whatever the lens. Only the
shape of the edges is taken from the camera, not the position of the corner, so that the fit remains a measurement.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from camcal.data.observations import View
from camcal.detect import saddle
from camcal.detect.corners import Corners
from camcal.detect.part import Picture
from camcal.detect.windows import limited

Array = np.ndarray

NO_AREA = 1e-12  #: squares per px²; a pixel of a board of 1e6 x 1e6 squares: smaller values are rounding
STEP = 0.5  #: px; step of the finite differences that give the board's directions in the picture
#: half-widths of the windows tried, in squares. Where board and print are perfect, the widest has the least noise; on
#: sheets of paper the middle ones are best; at .9 the window would include the next edge for a blur of 2 px
WINDOWS = (0.35, 0.5, 0.65, 0.8, 0.9)
#: px, and share of the size of a window: with the camera the corners and the sides of their squares change by less. If
#: they change more, the picture is decoded again
SLACK, LONGER = 3.0, 0.05
LARGEST = 60  #: px; half the side of the largest window, three times that of a first pass: .6 of its sigma


def refine_in_windows(
    picture: Picture,
    view: View,
    board_from_pixel: Callable[[Array], Array],
    cell: float,
    halves: Sequence[float | Array] = WINDOWS,
    blur: float | None = None,
) -> list[View]:
    """Fit the corners of a view again, in windows of several sizes.

    Parameters
    ----------
    picture : (height, width) uint8 or uint16 array, or the part around the target
    view : View
        With the corners found so far.
    board_from_pixel : callable
        Maps pixels (..., 2) to coordinates (..., 2) on the board, in the unit of the board; NaN where the
        ray misses it.
    cell : float
        Side of a square in that unit.
    halves : sequence of float or (N,) array
        Half-widths of the windows, in squares, ascending; see `saddle.wider_halves`.
    blur : float, optional
        Width (sigma) of the edges in the picture, px; by default it is found by a fit as in the first pass.

    Returns
    -------
    list of View
        For each size the view with new `uv` and `sigma`. A corner that cannot be fitted at one size has the values
        of the next smaller size; one that cannot be fitted at all keeps its original values.
    """
    sides, known = _sides(view.uv, board_from_pixel, cell)
    rows = np.flatnonzero(known)
    if blur is None:
        first = saddle.refine(picture, view.uv[rows], sides[rows])
        rows, corners = rows[first.good], first.take(first.good)
    else:
        corners = saddle.placed(view.uv[rows], sides[rows], blur)
    wide = [np.broadcast_to(half, len(view.uv))[rows] for half in halves]
    views = []
    for new in saddle.sharpen_sizes(picture, corners, sides[rows], board_from_pixel, wide, LARGEST):
        view = _moved(view, rows[new.good], new.take(new.good))
        views.append(view)
    return views


def margin(sides: Array | None = None) -> float:
    """How far from the corners the pixels of a second pass may lie, px.

    Parameters
    ----------
    sides : (N, 2, 2) array, optional
        Steps to the next corner along columns and rows, px, as far as they are known from the search.
    """
    if sides is None:
        return 2.0 * LARGEST + SLACK
    extent = np.abs(sides).sum(1).max(1) * limited(WINDOWS[-1], sides, LARGEST)
    return min((1 + LONGER) * float(extent.max()), 2.0 * LARGEST) + SLACK


def _moved(view: View, rows: Array, corners: Corners) -> View:
    """The view with some of its points measured again."""
    uv = view.uv.copy()
    uv[rows] = corners.uv
    sigma = None
    if view.sigma is not None or len(rows) == len(uv):
        sigma = np.ones(len(uv)) if view.sigma is None else view.sigma.copy()
        sigma[rows] = corners.sigma
    return replace(view, uv=uv, sigma=sigma)


def _sides(uv: Array, board_from_pixel: Callable[[Array], Array], cell: float) -> tuple[Array, Array]:
    """The steps (N, 2, 2) of one square along the board's axes, px, and where they are known (N,)."""
    cross = STEP * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]], float)
    board = board_from_pixel(uv[:, None] + cross)
    derivative = np.stack([board[:, 0] - board[:, 1], board[:, 2] - board[:, 3]], -1) / (2 * STEP * cell)
    area = derivative[:, 0, 0] * derivative[:, 1, 1] - derivative[:, 0, 1] * derivative[:, 1, 0]
    known = np.isfinite(area) & (np.abs(area) > NO_AREA)
    derivative = np.where(known[:, None, None], derivative, np.eye(2))
    return np.linalg.inv(derivative).transpose(0, 2, 1), known
