"""Identification of a grid of discs: its size, whether its rows are staggered, and its orientation."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from camcal.detect import grid
from camcal.detect.discs import Discs, links
from camcal.detect.lattice import Lattice, trim

Array = np.ndarray

FULL = 0.8  #: share of a board's discs that must be seen; more hidden ones leave its size to chance
MOST_PIECES = 4  #: grids of a picture that are looked at, the largest first
LEAST_SIDE = 3  #: discs to each side of a board of unknown size
LEAST_DISCS = 6  #: two rows of three: fewer do not tell a lattice from discs by chance


@dataclass(frozen=True)
class Grid:
    """The discs of a picture with their ids on a board.

    Attributes
    ----------
    ids : (N,) int array
        row * columns + column.
    discs : Discs
    columns, rows : int
    staggered : bool
    factor : float
        How many px of the picture were one px where the discs were found.
    """

    ids: Array
    discs: Discs
    columns: int
    rows: int
    staggered: bool
    factor: float


@dataclass(frozen=True)
class _Layout:
    """A numbering of discs: their indices (rows, places) or -1; staggered rows fill every other place."""

    index: Array
    staggered: bool

    @property
    def size(self) -> tuple[int, int]:
        """(columns, rows)."""
        rows, places = self.index.shape
        return places // (2 if self.staggered else 1), rows

    @property
    def number(self) -> int:
        """The number of discs."""
        return int((self.index >= 0).sum())

    @property
    def full(self) -> bool:
        """Return whether it is a board: enough discs are present, and staggered rows have theirs in the right
        places.
        """
        rows, columns = np.nonzero(self.index >= 0)
        if self.staggered and (((rows + columns) % 2).any() or self.index.shape[1] % 2):
            return False
        return len(rows) >= LEAST_DISCS and len(rows) / (self.size[0] * self.size[1]) >= FULL

    def rightward(self, discs: Discs) -> float:
        """The alignment of the rows with the right of the picture: cosine of the angle."""
        uv = Lattice.of(self.index, discs.centre).uv
        return Lattice(uv[:, ::2] if self.staggered else uv).rightward

    def grid(self, discs: Discs, factor: float) -> Grid:
        """The discs with their ids."""
        rows, places = np.nonzero(self.index >= 0)
        columns = self.size[0]
        ids = rows * columns + places // (2 if self.staggered else 1)
        return Grid(ids, discs.take(self.index[rows, places]), *self.size, self.staggered, factor)


def find_board(
    discs: Discs, staggered: bool | None, size: tuple[int, int] | None, factor: float
) -> tuple[Grid | None, list[tuple[int, int]]]:
    """Number the discs of a picture as the points of a board.

    Of the orientations that fit, the one whose rows run most nearly to the right of the picture is taken; of a
    board of unknown size the longer side is the columns.

    Parameters
    ----------
    discs : Discs
    staggered : bool or None
        None for either kind.
    size : (columns, rows) or None
        None for any size.
    factor : float
        Of the `Grid`.

    Returns
    -------
    grid : Grid or None
    sizes : list of (columns, rows)
        Of the boards of other kinds or sizes that were seen.
    """
    if len(discs) < LEAST_DISCS:
        return None, []
    seen: list[tuple[int, int]] = []
    for piece in grid.grow(*links(discs))[:MOST_PIECES]:
        ways = sorted((w for w in _layouts(piece) if w.full), key=lambda w: -w.number)
        wanted = [w for w in ways if staggered in (None, w.staggered)]
        if size is None:
            wanted = [w for w in wanted if min(w.size) >= LEAST_SIDE]
            wanted = [w for w in wanted if w.staggered or w.size[0] >= w.size[1]]
        else:
            wanted = [w for w in wanted if w.size == size]
        if wanted:
            most = [w for w in wanted if w.number == wanted[0].number]
            return max(most, key=lambda w: w.rightward(discs)).grid(discs, factor), seen
        seen += list(dict.fromkeys(w.size for w in ways))[:1]
    return None, seen


def _layouts(index: Array) -> Iterator[_Layout]:
    """The possible readings of a piece: in rows or staggered, whole or without sparse outer rows, from each end."""
    for staggered in (False, True):
        along = _diagonal(index) if staggered else index
        for part in (along, along[trim(along >= 0)]):
            for quarter in range(4):
                yield _Layout(np.rot90(part, quarter), staggered)


def _diagonal(index: Array) -> Array:
    """The same positions along their diagonals, rotated by 45 degrees: every other position is empty."""
    row, column = np.nonzero(index >= 0)
    x, y = column + row, row - column
    x, y = x - x.min(), y - y.min()
    turned = np.full((y.max() + 1, x.max() + 1), -1)
    turned[y, x] = index[row, column]
    return turned
