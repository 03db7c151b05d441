"""Which pixels around each corner take part in its fit.

A window is a parallelogram in the picture, a share of a square to each side of the corner along the board's
own directions, so that it holds no other edge however the board is tilted. Of a large window only the
pixels near its two edges are kept: the others say nothing about where the edges are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camcal.targets.local_map import BoardFromPixel

Array = np.ndarray

LARGEST = 32  #: px; half the side of the largest window
STENCIL = np.linspace(-1, 1, 5)  #: of the half-width; where the map to the board is asked for
FAR = np.float32(1e4)  #: px; where pixels that do not count are put: both edges are flat there


@dataclass(frozen=True)
class Windows:
    """The pixels of K windows, padded to the same number P.

    Attributes
    ----------
    origin : (K, 2) array
        Where q = 0 is, px of the picture.
    q : (K, 2, P) float32 array
        Pixels relative to the origin; `FAR` where they do not count.
    value : (K, P) float32 array
        Grey values.
    counts : (K, P) bool array
    inside : (K,) array
        Share of the window that lies in the picture.
    """

    origin: Array
    q: Array
    value: Array
    counts: Array
    inside: Array

    def take(self, rows: Array) -> Windows:
        """Only some of the windows."""
        return Windows(*(a[rows] for a in (self.origin, self.q, self.value, self.counts, self.inside)))


def cut(gray: Array, uv: Array, sides: Array, half: Array | float, reach: Array | float) -> Windows:
    """Cut the windows of all corners out of a picture.

    Parameters
    ----------
    gray : (height, width) array
    uv : (K, 2) array
        Approximate corners, px.
    sides : (K, 2, 2) array
        Steps to the next corner along the columns and along the rows, px: sides[k, 0] and sides[k, 1].
    half : float or (K,) array
        Half-width of a window as a share of the square.
    reach : float or (K,) array
        px; pixels farther than this from both edges are left out.
    """
    height, width = gray.shape
    share = _limited(half, sides)
    radius = int(np.ceil((np.abs(sides).sum(1).max(1) * share).max(initial=1.0)))
    grid = np.arange(-radius, radius + 1)
    dx, dy = (a.ravel() for a in np.meshgrid(grid, grid))
    base = np.rint(uv).astype(int)
    x = (dx + (base - uv)[:, :1]).astype(np.float32)
    y = (dy + (base - uv)[:, 1:]).astype(np.float32)
    inverse = np.linalg.inv(sides.transpose(0, 2, 1)).astype(np.float32)  # px -> squares
    s = np.abs(inverse[:, 0, :1] * x + inverse[:, 0, 1:] * y)
    t = np.abs(inverse[:, 1, :1] * x + inverse[:, 1, 1:] * y)
    limit = share.astype(np.float32)[:, None]
    window = (s < limit) & (t < limit)
    per_square = 1 / np.linalg.norm(inverse, axis=2)  # px between opposite sides of a square
    far = (np.broadcast_to(np.asarray(reach, float), len(uv))[:, None] / per_square).astype(np.float32)
    near = window & ((s < far[:, :1]) | (t < far[:, 1:]))
    columns, rows = base[:, :1] + dx, base[:, 1:] + dy
    within = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    inside = (window & within).sum(1) / np.maximum(window.sum(1), 1)
    return _pack(gray, uv, (x, y), (columns, rows), near & within, inside)


def _limited(half: Array | float, sides: Array) -> Array:
    """Half-widths (K,) of the windows as shares of the squares, so that none is larger than `LARGEST`."""
    longest = np.linalg.norm(sides, axis=2).max(1)
    return np.minimum(
        np.broadcast_to(np.asarray(half, float), len(sides)), LARGEST / np.maximum(longest, 1e-9)
    )


def straightened(
    windows: Windows, sides: Array, half: Array | float, board_from_pixel: BoardFromPixel
) -> Windows:
    """Replace the pixels' coordinates by ones in which the board's edges are straight.

    They are those on the board, brought to px by the map's derivative at the origin: there they agree with
    the picture's in place, direction and scale. The map is asked for a few points of each window; a cubic
    through these gives the others. Windows in which the map has no value are left as they are.

    Parameters
    ----------
    sides, half
        As for `cut`.
    board_from_pixel : callable
        px (K, P, 2) around the K corners -> coordinates (K, P, 2) on the board.
    """
    share = _limited(half, sides)
    stencil = np.stack(np.meshgrid(STENCIL, STENCIL), -1).reshape(-1, 2)
    offset = (stencil * share[:, None, None]) @ sides
    board = board_from_pixel(windows.origin[:, None] + offset)
    known = np.asarray(np.isfinite(board).reshape(len(board), -1).all(1))
    board = np.where(known[:, None, None], board, offset)
    scale = share * np.linalg.norm(sides, axis=2).max(1)
    x, y = np.moveaxis(offset / scale[:, None, None], -1, 0)
    design = np.stack([x**0, x, y, x * x, x * y, y * y, x**3, x * x * y, x * y * y, y**3], -1)
    transposed = design.transpose(0, 2, 1)
    cubic = np.linalg.solve(transposed @ design, transposed @ board)
    derivative = cubic[:, 1:3].transpose(0, 2, 1)
    bend = np.linalg.solve(derivative, cubic[:, 3:].transpose(0, 2, 1)) * scale[:, None, None]
    return Windows(windows.origin, _bent(windows, scale, bend), windows.value, windows.counts, windows.inside)


def _bent(windows: Windows, scale: Array, bend: Array) -> Array:
    """Add the quadratic and cubic terms, `bend` (K, 2, 7) times monomials of q / `scale`, to q."""
    x, y = np.moveaxis(windows.q * np.where(windows.counts, 1 / scale[:, None], 0)[:, None], 1, 0)
    x, y = x.astype(np.float32), y.astype(np.float32)
    terms = np.empty((len(x), 7, x.shape[1]), np.float32)
    for i, (a, b) in enumerate(((x, x), (x, y), (y, y))):
        np.multiply(a, b, out=terms[:, i])
    for i, (a, b) in enumerate(((0, x), (0, y), (2, x), (2, y)), 3):
        np.multiply(terms[:, a], b, out=terms[:, i])
    return windows.q + np.matmul(bend.astype(np.float32), terms)


def _pack(gray: Array, origin: Array, xy: tuple, at: tuple, keep: Array, inside: Array) -> Windows:
    """Move the pixels that count to the front, so that all windows are as long as the longest."""
    per_window = keep.sum(1)
    k, pixel = np.nonzero(keep)
    slot = np.arange(len(k)) - np.repeat(np.cumsum(per_window) - per_window, per_window)
    shape = (len(keep), int(per_window.max(initial=1)))
    q = np.full((shape[0], 2, shape[1]), FAR, np.float32)
    value, counts = np.zeros(shape, np.float32), np.zeros(shape, bool)
    q[k, 0, slot], q[k, 1, slot] = xy[0][k, pixel], xy[1][k, pixel]
    value[k, slot] = gray[at[1][k, pixel], at[0][k, pixel]]
    counts[k, slot] = True
    return Windows(origin, q, value, counts, inside)
