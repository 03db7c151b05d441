"""Which board a lattice of discs is: its size, whether its rows are staggered, which way round it stands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camcal.detect.discs import Discs

Array = np.ndarray

SPARSE = 0.4  #: a row at the rim with fewer discs than that share of the usual does not belong to the board
QUARTER = np.array([[0, -1], [1, 0]])  #: (x, y) -> (-y, x)
STAGGER = np.array([[1, 1], [-1, 1]])  #: along the diagonals, a staggered grid has rows


@dataclass(frozen=True)
class Grid:
    """Discs of a picture with their ids on a board.

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


def candidates(cells: Array) -> list[Array]:
    """The cells (N, 2) as they are, and without sparse rows at the rim, straight or along diagonals."""
    ways = [np.arange(len(cells)), _trim(cells)[0], _trim(cells @ STAGGER.T)[0]]
    return [cells[rows] for rows in sorted(ways, key=len, reverse=True)]


def _trim(x: Array) -> tuple[Array, Array]:
    rows = np.arange(len(x))
    while len(rows) > 6:
        thin = None
        for axis in (0, 1):
            values, counts = np.unique(x[rows, axis], return_counts=True)
            for end in (0, -1):
                if len(values) > 3 and counts[end] < SPARSE * np.median(counts):
                    thin = x[rows, axis] != values[end]
        if thin is None:
            break
        rows = rows[thin]
    return rows, x[rows]


def _fill(x: Array, staggered: bool) -> float:
    """Share of the places of the bounding box that are taken."""
    if not len(x):
        return 0.0
    extent = np.ptp(x, axis=0) + 1
    return len(x) / (extent.prod() / (2 if staggered else 1))


def best_box(cells: Array) -> list[tuple[int, int]]:
    """The size (columns, rows) of a complete rectangle of cells, the longer side first; or nothing."""
    if len(cells) < 6:
        return []
    straight, slanted = _fill(cells, False), _fill(cells @ STAGGER.T, True)
    if max(straight, slanted) < 0.8:
        return []
    extent = np.ptp(cells if straight >= slanted else cells @ STAGGER.T, axis=0) + 1
    if straight >= slanted:
        return [(int(extent.max()), int(extent.min()))]
    return [(int(w) // 2, int(h)) for w, h in (extent, extent[::-1]) if w % 2 == 0][:1]


def as_board(
    cells: Array,
    piece: dict[tuple[int, int], int],
    discs: Discs,
    staggered: bool | None,
    size: tuple[int, int] | None,
    factor: float,
) -> Grid | None:
    """Number the discs as the points of a board, or None where they are none of that kind and size.

    Of the orientations that fit, the one whose rows run most nearly to the right of the picture is taken.
    """
    found = []
    for slanted in (False, True) if staggered is None else (staggered,):
        x = cells @ STAGGER.T if slanted else cells
        for quarter in range(4):
            turned = x @ np.linalg.matrix_power(QUARTER, quarter).T
            place = turned - turned.min(0)
            extent = place.max(0) + 1
            if slanted and ((place.sum(1) % 2).any() or extent[0] % 2):
                continue
            columns, rows = int(extent[0]) // (2 if slanted else 1), int(extent[1])
            wanted = (columns, rows) == size if size else _fill(x, slanted) > 0.8 and min(columns, rows) >= 3
            if wanted:
                ids = place[:, 1] * columns + place[:, 0] // (2 if slanted else 1)
                members = discs.take(np.array([piece[tuple(c)] for c in cells.tolist()]))
                found.append((_rightness(place, members), Grid(ids, members, columns, rows, slanted, factor)))
    if not found:
        return None
    if size is None:  # of a board of unknown size the longer side is the columns
        longest = (
            max(g.columns for _, g in found if not g.staggered)
            if not all(g.staggered for _, g in found)
            else 0
        )
        found = [(r, g) for r, g in found if g.staggered or g.columns == longest]
    return max(found, key=lambda f: f[0])[1]


def _rightness(place: Array, discs: Discs) -> float:
    """How nearly the first axis of the places runs to the right: cosine of the angle."""
    design = np.c_[place, np.ones(len(place))]
    along = np.linalg.lstsq(design, discs.centre, rcond=None)[0][0]
    return float(along[0] / np.linalg.norm(along))
