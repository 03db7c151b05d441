"""Which pixels around each corner take part in its fit.

A window is a parallelogram in the picture, a share of a square to each side of the corner along the board's
own directions, so that it holds no other edge however the board is tilted. Of a large window only the
pixels near its two edges are kept: the others say nothing about where the edges are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camcal.detect.local_map import BoardFromPixel

Array = np.ndarray

LARGEST = 20  #: px; half the side of the largest window
STENCIL = np.linspace(-1, 1, 5)  #: of the half-width; where the map to the board is asked for
UNUSED = np.float32(1)  #: their grey value, which is at no limit
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


def cut(
    gray: Array, uv: Array, sides: Array, half: Array | float, reach: Array | float, largest: float = LARGEST
) -> Windows:
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
    largest : float
        px; half the side of the largest window.
    """
    share = _limited(half, sides, largest)
    base = np.rint(uv)
    arms = sides * share[:, None, None]
    bands = [_Band.along(arms[:, i], arms[:, 1 - i], reach) for i in (0, 1)]
    first, second = (band.pixels() for band in bands)
    x, y = np.concatenate([first, second], 2)
    counts = np.ones(x.shape, bool)
    counts[:, first.shape[2] :] = ~bands[0].covers(*second)  # what both bands hold is taken once
    shift = (base - uv).astype(np.float32)
    q = np.stack([x + shift[:, :1], y + shift[:, 1:]], 1)
    inverse = np.linalg.inv(sides.transpose(0, 2, 1)).astype(np.float32)  # px -> squares
    square = inverse @ q
    np.abs(square, out=square)
    counts &= square.max(1) < share.astype(np.float32)[:, None]
    columns, rows = (
        x.astype(np.int32) + base[:, :1].astype(np.int32),
        y.astype(np.int32) + base[:, 1:].astype(np.int32),
    )
    within = (columns >= 0) & (columns < gray.shape[1]) & (rows >= 0) & (rows < gray.shape[0])
    total = np.maximum(counts.sum(1), 1)
    counts &= within
    value = gray.ravel()[np.where(counts, rows * gray.shape[1] + columns, 0)].astype(np.float32)
    unused = ~counts
    np.copyto(q, FAR, where=unused[:, None])
    np.copyto(value, UNUSED, where=unused)
    return Windows(uv, q, value, counts, counts.sum(1) / total)


@dataclass(frozen=True)
class _Band:
    """The pixels along an edge through each of K corners, up to `width` to both sides, counted along x or y.

    Attributes
    ----------
    steep : (K, 1) bool array
        Whether the edge runs along y rather than along x.
    slope : (K, 1) float32 array
        px across for a px along.
    length : (K, 1) array
        px to each side of the corner.
    """

    steep: Array
    slope: Array
    length: Array
    width: int

    @classmethod
    def along(cls, half_edge: Array, other: Array, reach: Array | float) -> _Band:
        """Within `reach` px of the edge from -`half_edge` to `half_edge` (K, 2), inside the window."""
        steep = np.abs(half_edge[:, 1]) > np.abs(half_edge[:, 0])
        major = np.where(steep, half_edge[:, 1], half_edge[:, 0])
        minor = np.where(steep, half_edge[:, 0], half_edge[:, 1])
        slope = minor / np.where(major == 0, 1, major)
        # across is counted along x or y, to which the edge lies at up to 45 degrees
        width = int(np.ceil(np.max(reach * np.sqrt(1 + slope**2), initial=1.0)))
        beyond = np.minimum(np.abs(np.where(steep, other[:, 1], other[:, 0])), width)
        length = np.abs(major) + beyond
        return cls(steep[:, None], slope[:, None].astype(np.float32), length[:, None], width)

    def pixels(self) -> Array:
        """x and y (2, K, P), whole numbers as float32."""
        reach = int(np.ceil(self.length.max(initial=1.0)))
        along = np.arange(-reach, reach + 1, dtype=np.float32)
        across = np.arange(-self.width, self.width + 1, dtype=np.float32)
        minor = (np.rint(self.slope * along)[:, :, None] + across).reshape(len(self.slope), -1)
        major = np.broadcast_to(np.repeat(along, len(across)), minor.shape)
        return np.stack([np.where(self.steep, minor, major), np.where(self.steep, major, minor)])

    def covers(self, x: Array, y: Array) -> Array:
        """Whether pixels (K, P) are among those of the band."""
        major, minor = np.where(self.steep, y, x), np.where(self.steep, x, y)
        reach = np.ceil(self.length.max(initial=1.0))
        near = np.abs(minor - np.rint(self.slope * major)) <= self.width
        return near & (np.abs(major) <= reach)


def _limited(half: Array | float, sides: Array, largest: float = LARGEST) -> Array:
    """Half-widths (K,) of the windows as shares of the squares, so that none is larger than `largest` px."""
    longest = np.linalg.norm(sides, axis=2).max(1)
    return np.minimum(
        np.broadcast_to(np.asarray(half, float), len(sides)), largest / np.maximum(longest, 1e-9)
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
