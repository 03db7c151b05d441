"""Local maps from the picture to the board, fitted to the corners alone, under which the board's edges are straight.

A homography describes the perspective; the remainder, from the lens and a bent sheet, varies so slowly that a
polynomial of the fourth degree fitted to the corners around each corner is accurate within half a square.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from camcal.detect.polynomials import CUBIC, LINEAR, QUADRATIC, QUARTIC, monomials
from camcal.geometry.homography import homographies
from camcal.geometry.numbers import distinct

Array = np.ndarray

#: from px (K, P, 2) near each of K corners to coordinates (K, P, 2) in which edges are straight, in squares
BoardFromPixel = Callable[[Array], Array]

#: corners along each side of the block from which a corner's map is made; a polynomial of the fourth degree needs 5,
#: and with one more the noise of these corners adds 1 % to that of the corner. A cubic left .003 px with large squares
#: and strong distortion
SPAN = 6
STEEPEST = (
    4.0  #: largest ratio of depths for which a homography is used: a board at a distance of its length has 2
)
RIDGE = 1e-9  #: keeps the equations solvable if a whole line of corners is missing
#: corners that a polynomial of that degree needs: 1.4 per coefficient
FOR_QUARTIC, FOR_CUBIC, FOR_QUADRATIC = 21, 14, 8


def board_from_corners(uv: Array) -> BoardFromPixel:
    """A map for each corner that is present, in the order of `uv[present]`.

    Parameters
    ----------
    uv : (rows, columns, 2) array
        Corners, px; NaN where one is missing.
    """
    rows, columns = uv.shape[:2]
    present = np.isfinite(uv[..., 0])
    board = np.stack(np.meshgrid(np.arange(columns, dtype=float), np.arange(rows, dtype=float)), -1)
    flat = _perspective(uv[present], board[present])
    near = np.full_like(uv, np.nan)
    near[present] = flat(uv[present])
    centre, coefficients = _polynomials(near, board, present)

    def map_pixels(pixels: Array) -> Array:
        offset = flat(pixels) - centre[:, None]
        return _powers(offset).transpose(0, 2, 1) @ coefficients

    return map_pixels


def _perspective(uv: Array, board: Array) -> Callable[[Array], Array]:
    """The homography from the picture to the board; an affinity if the perspective is too strong to be reliable."""
    h = homographies(uv[None], board[None], steps=0)[0]
    depth = uv @ h[2, :2] + h[2, 2]
    if not np.isfinite(h).all() or depth.min() <= 0 or depth.max() > STEEPEST * depth.min():
        design = np.c_[uv, np.ones(len(uv))]
        affine = np.linalg.lstsq(design, board, rcond=None)[0]
        h = np.vstack([affine.T, [0, 0, 1]])

    def apply(pixels: Array) -> Array:
        return (pixels @ h[:2, :2].T + h[:2, 2]) / (pixels @ h[2, :2] + h[2, 2])[..., None]

    return apply


def _polynomials(near: Array, board: Array, present: Array) -> tuple[Array, Array]:
    """Centres (K, 2) and coefficients (K, 15, 2) of the polynomials from `near` to `board`."""
    rows, columns = present.shape
    at = np.argwhere(present)
    height, width = min(SPAN, rows), min(SPAN, columns)
    top = np.clip(at[:, 0] - height // 2, 0, rows - height)
    left = np.clip(at[:, 1] - width // 2, 0, columns - width)
    block = (np.arange(height)[:, None] * columns + np.arange(width)).ravel()
    k = (top * columns + left)[:, None] + block
    known = present.ravel()[k]
    centre = near[present]
    x = np.where(known[..., None], near.reshape(-1, 2)[k] - centre[:, None], 0.0)
    y = np.where(known[..., None], board.reshape(-1, 2)[k], 0.0)
    degree = _terms(known.sum(1), min(height, width))
    design = _powers(x) * known[:, None]
    coefficients = np.zeros((len(at), QUARTIC, 2))
    for terms in distinct(degree):
        k = np.flatnonzero(degree == terms)
        a = design[k, :terms]
        normal = a @ a.transpose(0, 2, 1) + RIDGE * np.eye(terms)
        coefficients[k, :terms] = np.linalg.solve(normal, a @ y[k])
    return centre, coefficients


def _terms(number: Array, side: int) -> Array:
    """The number of monomials determined by `number` corners in a block of `side` per side."""
    needed = ((QUARTIC, FOR_QUARTIC, 5), (CUBIC, FOR_CUBIC, 4), (QUADRATIC, FOR_QUADRATIC, 3))
    allowed = [(number >= corners) & (side >= least) for _, corners, least in needed]
    return np.asarray(np.select(allowed, [terms for terms, _, _ in needed], LINEAR))


def _powers(points: Array) -> Array:
    """Monomials (K, 15, P) of points (K, P, 2)."""
    out = np.empty((len(points), QUARTIC, points.shape[1]))
    monomials(points[..., 0], points[..., 1], out)
    return out
