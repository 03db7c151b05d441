"""The pixels around each corner that are used in its fit.

A window is a parallelogram in the picture that extends a fraction of a square to each side of the corner along the
directions of the board, so that it contains no other edge however the board is tilted. Of a large window only the
pixels near its two edges are kept, as the others do not depend on the positions of the edges.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from camcal.detect.local_map import BoardFromPixel
from camcal.detect.part import Picture, values
from camcal.records import dataclass

Array = np.ndarray

LARGEST = 20  #: px; half the side of the largest window: its Cramér-Rao bound is .01 px at a noise of 5 %
#: of a window's half-width, along an edge: positions at which the map to the board is evaluated. A polynomial of the
#: fifth degree needs 6; a cubic left .001 px in windows of 60 px
ALONG = np.linspace(-1, 1, 7)
BESIDE = 0.02  #: of a window's half-width; step of the differences across an edge
#: of the scale at the corner; if the far end of a window has less, the board is seen so obliquely that an edge is not
#: a curve of low degree; a map that is not of a plane may have any scale
LEAST_SCALE = 0.3
MOST_BEND = 1.0  #: of a window's half-width; a fisheye bends edges by a tenth of it, a wrong map by more
UNUSED = np.float32(1)  #: grey value of unused pixels, which is not a clipping limit
TILE = 4  #: px; side of the tiles in which pixels near an edge are searched
IN_TILE = (np.stack(np.divmod(np.arange(TILE**2), TILE)[::-1]) - 0.5 * (TILE - 1)).astype(
    np.float32
)  #: px (x, y)
FAR = np.float32(1e4)  #: px; coordinates of unused pixels, where the model of both edges is constant


@dataclass(frozen=True)
class Windows:
    """The pixels of K windows, padded to the same number P.

    Attributes
    ----------
    origin : (K, 2) array
        Position of q = 0, px of the picture.
    q : (K, 2, P) float32 array
        Pixels relative to the origin; `FAR` for unused ones.
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
        """Select some of the windows."""
        return Windows(*(a[rows] for a in (self.origin, self.q, self.value, self.counts, self.inside)))

    def inner(self, size: Inner) -> Windows:
        """The smaller windows inside these."""
        q, value, counts = (a[..., : size.columns] for a in (self.q, self.value, self.counts))
        return Windows(self.origin, q, value, counts, size.inside)

    def thinned(self, most: int) -> Windows:
        """The windows with every second, third, ... pixel, so that about `most` or fewer are left."""
        step = slice(None, None, max(1, round(self.value.shape[1] / most)))
        return replace(self, q=self.q[..., step], value=self.value[:, step], counts=self.counts[:, step])


class Inner(NamedTuple):
    """Smaller windows inside those of K corners, consisting of their first pixels.

    Attributes
    ----------
    columns : int
        Number of these pixels.
    inside : (K,) array
        Share of the smaller window that lies in the picture.
    """

    columns: int
    inside: Array


def cut(
    picture: Picture,
    uv: Array,
    sides: Array,
    half: Array | float,
    reach: Array | float,
    largest: float = LARGEST,
) -> Windows:
    """Cut the windows of all corners out of a picture.

    Parameters
    ----------
    picture : (height, width) array, or the part around the target
    uv : (K, 2) array
        Approximate corners, px.
    sides : (K, 2, 2) array
        Steps to the next corner along the columns and along the rows, px: sides[k, 0] and sides[k, 1].
    half : float or (K,) array
        Half-width of a window as a share of the square.
    reach : float or (K,) array
        px; pixels farther than this from both edges are omitted.
    largest : float
        px; half the side of the largest window.
    """
    return nested(picture, uv, sides, limited(half, sides, largest)[None], reach)[0]


def nested(
    picture: Picture, uv: Array, sides: Array, shares: Array, reach: Array | float
) -> tuple[Windows, list[Inner]]:
    """Cut windows of several sizes out of a picture, each with the pixels of the smaller ones first.

    Parameters
    ----------
    picture, uv, sides, reach
        As for `cut`.
    shares : (W, K) array
        Half-widths of the windows as shares of the squares, ascending along the first axis.

    Returns
    -------
    Windows
        The largest.
    list of Inner
        One for each of `shares`; the last comprises all pixels.
    """
    base = np.rint(uv).astype(int)
    shift = (base - uv).astype(np.float32)
    extent = np.ceil((np.abs(sides).sum(1) * shares[-1][:, None]).max(0, initial=1.0))
    corner, dx, dy, farther = _near_edges(extent, shift, sides * shares[-1][:, None, None], reach)
    window = np.zeros(len(corner), np.int8)
    for share in shares[:-1] / shares[-1]:
        window += farther >= share.astype(np.float32)[corner]
    (dx, dy), counts, columns = _packed(corner, (dx, dy), window, *shares.shape)
    q = np.stack([dx + shift[:, :1], dy + shift[:, 1:]], 1)
    column, row = (d.astype(np.int32) + base[:, i, None] for i, d in enumerate((dx, dy)))
    totals = [counts[:, :n].sum(1) for n in columns]
    if ((base - extent < 0) | (base + extent >= picture.shape[1::-1])).any():
        counts &= (column >= 0) & (column < picture.shape[1]) & (row >= 0) & (row < picture.shape[0])
    unused = ~counts
    value = values(picture, column, row, counts).astype(np.float32)
    value[unused] = UNUSED
    np.copyto(q, FAR, where=unused[:, None])
    inside = [counts[:, :n].sum(1) / np.maximum(total, 1) for n, total in zip(columns, totals, strict=True)]
    return Windows(uv, q, value, counts, inside[-1]), list(map(Inner, columns, inside))


def _near_edges(
    extent: Array, shift: Array, axes: Array, reach: Array | float
) -> tuple[Array, Array, Array, Array]:
    """The pixels of windows that are near one of their edges, corner by corner.

    Tiles without such pixels, the greater part of a large window, are excluded first.

    Parameters
    ----------
    extent : (2,) array
        px; half the sides of a box that holds every window.
    shift : (K, 2) float32 array
        From the corners to the middle of their boxes, px.
    axes : (K, 2, 2) array
        Half-widths of the windows along columns and rows, px.
    reach : float or (K,) array
        As for `cut`.

    Returns
    -------
    corner : (M,) int array
        Ascending.
    dx, dy : (M,) float32 arrays
        From the middle of the box, px.
    farther : (M,) float32 array
        Distance from the farther edge, in half-widths of the window.
    """
    inverse = np.linalg.inv(axes.transpose(0, 2, 1)).astype(np.float32)
    within = (np.reshape(reach, (-1, 1)) * np.linalg.norm(inverse, axis=2)).astype(np.float32)
    margin = 0.5 * (TILE - 1) * np.abs(inverse).sum(2)
    x, y = (np.arange(0.5 * (TILE - 1) - n, n + TILE, TILE, dtype=np.float32) for n in extent)
    across = [
        (by[:, 1:] * (y + shift[:, 1:]))[:, :, None] + (by[:, :1] * (x + shift[:, :1]))[:, None]
        for by in (inverse[:, 0], inverse[:, 1])
    ]
    distance = [np.abs(a) - m[:, None, None] for a, m in zip(across, margin.T, strict=True)]
    near = (distance[0] < within[:, 0, None, None]) | (distance[1] < within[:, 1, None, None])
    near &= (distance[0] < 1) & (distance[1] < 1)
    corner, row, column = np.nonzero(near)
    u, v = (
        np.abs(a[corner, row, column][:, None] + inside[corner])
        for a, inside in zip(across, (inverse @ IN_TILE).transpose(1, 0, 2), strict=True)
    )
    farther = np.maximum(u, v)
    near = (u < within[corner, :1]) | (v < within[corner, 1:])
    near &= farther < 1
    tile, pixel = np.nonzero(near)
    dx, dy = x[column[tile]] + IN_TILE[0][pixel], y[row[tile]] + IN_TILE[1][pixel]
    return corner[tile], dx, dy, farther[tile, pixel]


def _packed(
    corner: Array, of_pixels: tuple[Array, ...], window: Array, sizes: int, count: int
) -> tuple[list[Array], Array, list[int]]:
    """Arrange values (M,) of pixels as (K, P), those of smaller windows first; padded with 0 for each of `sizes`.

    Returns
    -------
    packed : list of (K, P) float32 arrays
    counts : (K, P) bool array
        False for padding.
    columns : list of int
        How many columns belong to the windows of each size.
    """
    places, columns = np.empty(len(corner), int), [0]
    for size in range(sizes):
        some = window == size if sizes > 1 else slice(None)
        number = np.bincount(corner[some], minlength=count)
        places[some] = np.arange(number.sum()) - np.repeat(np.cumsum(number) - number, number) + columns[-1]
        columns.append(columns[-1] + int(number.max(initial=0)))
    places += corner * columns[-1]
    counts = np.zeros(count * columns[-1], bool)
    counts[places] = True
    packed = [np.zeros(len(counts), np.float32) for _ in of_pixels]
    for given, new in zip(of_pixels, packed, strict=True):
        new[places] = given
    return [a.reshape(count, -1) for a in packed], counts.reshape(count, -1), columns[1:]


def limited(half: Array | float, sides: Array, largest: float = LARGEST) -> Array:
    """Half-widths (K,) of the windows as fractions of the squares, limited to `largest` px."""
    longest = np.linalg.norm(sides, axis=2).max(1)
    return np.minimum(half, largest / np.maximum(longest, 1e-9))


def straightened(
    windows: Windows, sides: Array, half: Array | float, board_from_pixel: BoardFromPixel, blur: Array | float
) -> Windows:
    """Replace the pixels' coordinates by ones in which the board's edges are straight and distances are those in px.

    Let s and t be the coordinates along a window's axes and a(s, t) the board coordinate across an edge. That edge is
    the curve of constant a,

        s = σ(t) = (a(0, 0) - a(0, t)) / a_s(0, t)

    and s is replaced by the distance from the curve, s - σ(t), without the linear part of σ, which is the direction
    of the edge; t is likewise replaced by the distance from the other edge. Distances remain those in the picture,
    because there the blur is equal on both sides of an edge, unlike on a board seen obliquely. The map is evaluated
    at points of each edge, and a polynomial interpolates between them. Windows in which the map is undefined remain
    unchanged.

    Parameters
    ----------
    sides, half
        As for `cut`, none larger than its `largest`.
    board_from_pixel : callable
        px (K, P, 2) around the K corners -> coordinates (K, P, 2) on the board, the first along `sides[:, 0]`.
    blur : float or (K,) array
        Standard deviation, px.
    """
    axes = (
        sides * np.broadcast_to(half, len(sides))[:, None, None]
    )  # of a window: half its width along columns and rows
    cross = np.stack([np.stack(np.meshgrid([-BESIDE, BESIDE], ALONG, indexing="ij"), -1)] * 2)
    cross[1] = cross[1, ..., ::-1]  # (edge, side, position, 2): (s, t) beside the two edges
    board = board_from_pixel(windows.origin[:, None] + cross.reshape(-1, 2) @ axes)
    board = board.reshape(-1, *cross.shape)
    square = np.square(axes).sum(2)
    # the projection of a pixel onto an edge: its coordinate along it, if the axes are not at right angles
    lean = (axes[:, 0] * axes[:, 1]).sum(1)[:, None] / square
    spread = np.square(np.broadcast_to(blur, len(axes)))[:, None] / square
    place = np.linalg.inv(axes.transpose(0, 2, 1)).astype(np.float32) @ windows.q
    place *= windows.counts[:, None]
    bend = np.empty_like(place)
    for along, across in ((1, 0), (0, 1)):
        foot = place[:, across] * lean[:, along, None].astype(np.float32)
        foot += place[:, along]
        bend[:, across] = _bend(_curve(board[:, across, ..., across]), spread[:, along], foot)
    return replace(windows, q=windows.q + axes.transpose(0, 2, 1).astype(np.float32) @ bend)


def _curve(beside: Array) -> Array:
    """The coefficients (K, 4) of t² to t⁵ of the curve of an edge; 0 where the map is undefined or implausible.

    Parameters
    ----------
    beside : (K, 2, N) array
        The board coordinate across the edge, at `BESIDE` to either side of its tangent and at the positions `ALONG`.
    """
    slope, middle = (beside[:, 1] - beside[:, 0]) / (2 * BESIDE), beside.mean(1)
    centre = slope[:, [len(ALONG) // 2]]
    with np.errstate(all="ignore"):
        away = (middle[:, [len(ALONG) // 2]] - middle) / slope
        sound = np.isfinite(away).all(1) & (slope > LEAST_SCALE * np.abs(centre)).all(1)
    curve = np.where(sound[:, None], away, 0.0) @ THROUGH.T
    curve[np.abs(curve).sum(1) > MOST_BEND] = 0
    return curve


def _bend(curve: Array, variance: Array, along: Array) -> Array:
    """Distances (K, P) of blurred edges from their tangents at positions (K, P) along them; positive towards -s.

    Blur moves a curved edge towards its centre of curvature: each power of t becomes its mean over a Gaussian with
    the variance v (K,) of the blur, such as t² + v instead of t².
    """
    two, three, four, five = curve.T
    v = variance
    terms = (
        two * v + 3 * four * v * v, 3 * three * v + 15 * five * v * v, two + 6 * four * v, three + 10 * five * v,
        four, five,
    )  # fmt: skip
    first, *rest = (-t.astype(np.float32)[:, None] for t in terms[::-1])
    bend = first * along
    for term in rest[:-1]:
        bend += term
        bend *= along
    bend += rest[-1]
    return bend


def _through() -> Array:
    """The matrix (4, N) from values at `ALONG` to the coefficients of t² to t⁵ of the polynomial through them."""
    return np.asarray(np.linalg.pinv(np.vander(ALONG, 6, increasing=True))[2:])


THROUGH = _through()
