"""Identification of a grid of discs: its size, whether its rows are staggered, and its orientation."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from camcal.detect import grid
from camcal.detect.discs import Discs, links
from camcal.detect.lattice import Lattice, trim
from camcal.detect.targets.base import LEAST_SEEN, Miss
from camcal.records import dataclass

Array = np.ndarray

#: share of the next row that must lie outside the picture for the board possibly to continue there: half, as part of
#: a row stays inside where the grid is tilted against the border
OUTSIDE = 0.5


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
        Number of px of the picture per px of the reduced picture in which the discs were found.
    """

    ids: Array
    discs: Discs
    columns: int
    rows: int
    staggered: bool
    factor: float

    def leaves(self, shape: tuple[int, ...]) -> bool:
        """Return whether the next row or column beyond an edge would lie outside a picture of that shape, so that the
        board may continue there.
        """
        flat = np.full((self.rows * self.columns, 2), np.nan)
        flat[self.ids] = self.discs.centre
        uv: Array = flat.reshape(self.rows, self.columns, 2)
        apart = 2 if self.staggered else 1  # rows that repeat
        near = float(np.median(self.discs.radius))  # a disc cut off by the border is not detected
        last = np.array(shape[1::-1]) - 1 - near
        for lines, step in ((uv, apart), (uv.swapaxes(0, 1), 1)):
            if len(lines) <= step:  # no second line from which the next would follow
                continue
            for edge, inner in ((lines[0], lines[step]), (lines[-1], lines[-1 - step])):
                beyond = edge + (edge - inner) / step
                beyond = beyond[np.isfinite(beyond[:, 0])]
                if len(beyond) and ((beyond < near) | (beyond > last)).any(1).mean() > OUTSIDE:
                    return True
        return False

    def instead_of(self, columns: int, rows: int, what: str, shape: tuple[int, ...]) -> Miss:
        """State why this grid is not the requested one of `columns` x `rows` discs or squares (`what`)."""
        size, wanted = (self.columns, self.rows), (columns, rows)
        seen = "x".join(map(str, size))
        if self.leaves(shape) and part_of(size, wanted):
            said = f"the grid extends beyond the picture: {seen} of its {columns}x{rows} {what} are visible"
            return Miss("cut-off", said, {"size": size})
        said = f"the picture shows a grid of {seen} {what}, not {columns}x{rows}"
        return Miss("other-size", said, {"size": size})


def part_of(size: tuple[int, int], whole: tuple[int, int]) -> bool:
    """Return whether a grid of one size fits into one of another, in either orientation."""
    return all(a <= b for a, b in zip(sorted(size), sorted(whole), strict=True))


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
        """Return whether it is a complete board: enough discs are present, and those of staggered rows alternate."""
        rows, columns = np.nonzero(self.index >= 0)
        if self.staggered and (((rows + columns) % 2).any() or self.index.shape[1] % 2):
            return False
        return len(rows) >= grid.LEAST_NODES and len(rows) / (self.size[0] * self.size[1]) >= LEAST_SEEN

    def rightward(self, discs: Discs) -> float:
        """The cosine of the angle between the rows and the u axis of the picture."""
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
) -> tuple[Grid | None, list[Grid]]:
    """Number the discs of a picture as the points of a board.

    Of the orientations that fit, the one whose rows are closest to the u axis of the picture is chosen; the longer
    side of a board of unknown size is its width (the number of columns).

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
    others : list of Grid
        Boards of other kinds or sizes in the picture.
    """
    if len(discs) < grid.LEAST_NODES:
        return None, []
    seen: list[Grid] = []
    for piece in grid.grow(*links(discs))[: grid.MOST_PIECES]:
        ways = sorted((w for w in _layouts(piece) if w.full), key=lambda w: -w.number)
        wanted = [w for w in ways if staggered in (None, w.staggered)]
        if size is None:
            wanted = [w for w in wanted if min(w.size) >= grid.LEAST_SIDE]
            wanted = [w for w in wanted if w.staggered or w.size[0] >= w.size[1]]
        else:
            wanted = [w for w in wanted if w.size == size]
        if wanted:
            most = [w for w in wanted if w.number == wanted[0].number]
            return max(most, key=lambda w: w.rightward(discs)).grid(discs, factor), seen
        seen += [w.grid(discs, factor) for w in ways[:1]]
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
