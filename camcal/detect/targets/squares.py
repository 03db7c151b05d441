"""Separate dark squares in rows, like Zhang's of 1998 and BoofCV's square grid: `squares:8x8:12.7mm:0.78`.

COLUMNSxROWS squares of the given side; the gap between them is a fraction of it. Point 4 k + c is corner c of the
k-th square, row by row: upper left, upper right, lower left, lower right. The origin is the upper left corner of
the first square.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from camcal.detect.board_points import from_points
from camcal.detect.disc_grid import Grid, find_board
from camcal.detect.evenness import unevenly_dark
from camcal.detect.outlines import as_discs, find_squares, plain_inside
from camcal.detect.pyramid import reduced, reductions, to_8_bits
from camcal.detect.targets import outlined
from camcal.detect.targets.base import (
    DEFAULT_SECONDS,
    GAPS,
    LEAST_POINTS,
    LEAST_SEEN,
    LEAST_UNASKED,
    Detection,
    Miss,
    Pattern,
    Target,
    check_arguments,
    checked_gap,
    clock,
    ratio,
    time_for_next,
)
from camcal.detect.targets.dictionaries import rectangle
from camcal.settings.sizes import parse_grid, parse_length

Array = np.ndarray

EXAMPLE = "squares:8x8:12.7mm:0.78"
UNIT = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])  #: corners of a square, row by row
CLOCKWISE = np.array([0, 1, 3, 2])  #: their clockwise order; the permutation is its own inverse


class SquareGrid(Target):
    """A grid of `columns` x `rows` squares of side `square`; the gap between them is `spacing` times the side."""

    kind = "squares"
    point_kind = "corner"

    def __init__(
        self, columns: int, rows: int, square: float = 1.0, spacing: float = 1.0, unit: str = "square"
    ):
        super().__init__(columns, rows, square, unit)
        self.spacing = checked_gap(spacing, "0.78")

    @property
    def pitch(self) -> float:
        """The distance between neighbouring squares."""
        return self.square * (1 + self.spacing)

    @property
    def _origins(self) -> Array:
        column, row = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        return np.c_[column.ravel(), row.ravel()] * self.pitch

    @property
    def points(self) -> Array:
        """The corners of all squares (4 K, 3)."""
        corners = self._origins[:, None] + self.square * UNIT
        return np.c_[corners.reshape(-1, 2), np.zeros(4 * self.columns * self.rows)]

    def find(self, gray: Array, seconds: float = DEFAULT_SECONDS) -> Detection | Miss:
        """Search for the whole grid; up to a fifth of the squares may be hidden."""
        found, others = search(gray, seconds, (self.columns, self.rows))
        if found is not None:
            return self._fitted(gray, *found)
        if others:
            return others[0].instead_of(self.columns, self.rows, "squares", gray.shape)
        return Miss("none", "no grid of squares was found")

    def _fitted(self, gray: Array, grid: Grid, quads: Array) -> Detection | Miss:
        centres = self._origins[grid.ids] + 0.5 * self.square
        _, jacobian, _ = from_points(centres, centres, grid.discs.centre)
        starts = _ordered(quads, grid.discs.centre, jacobian)
        board = self.points.reshape(-1, 4, 3)[grid.ids][:, CLOCKWISE, :2]
        fitted, sides = outlined.fit_squares(gray, starts, self.spacing, board)
        fitted = fitted.take_corners(CLOCKWISE)
        keep = outlined.in_place(self.points, self.square, grid.ids, fitted)
        total = self.columns * self.rows
        if keep.sum() < max(LEAST_POINTS, LEAST_SEEN * total):
            return Miss("none", f"a grid was found, but only {keep.sum()} of its {total} squares can be used")
        return outlined.detection(gray, total, grid.ids, fitted, keep, sides)

    def pattern(self) -> Pattern:
        """Black squares, with a margin of half a gap around them."""
        s, margin = self.square, 0.5 * self.square * max(self.spacing, 0.5)
        shapes = [rectangle(x, y, x + s, y + s) for x, y in self._origins]
        far = self._origins.max(0) + s + margin
        return Pattern(tuple(shapes), np.zeros((0, 3)), (-margin, -margin, float(far[0]), float(far[1])))

    @classmethod
    def parse(cls, arguments: list[str], named: dict[str, str]) -> SquareGrid:
        """Read `8x8:12.7mm:0.78`.

        Raises
        ------
        UsageError
            Where an argument is missing, unknown or out of range.
        """
        takes = "columns and rows, the side of a square and the gap as a fraction of it"
        check_arguments("squares", takes, arguments, named, (), EXAMPLE)
        (columns, rows), (square, unit) = parse_grid(arguments[0]), parse_length(arguments[1])
        spacing = ratio(arguments[2], "the gap", EXAMPLE)
        return cls(columns, rows, square, spacing, unit)

    def _arguments(self) -> list[str]:
        return [self._length(self.square), f"{self.spacing:.4g}"]

    def describe(self) -> dict[str, Any]:
        """The report's entry `target`."""
        return super().describe() | {"spacing": self.spacing}


def find_any(gray: Array, seconds: float) -> tuple[Grid, float] | None:
    """The grid and the spacing (to a few per cent) of a grid of separate squares, if a picture shows one.

    Windows in a wall also form such grids: here the squares must be uniformly dark, as dark as their neighbours, and
    fit as closely as printed ones.
    """
    found, _ = search(gray, seconds, None)
    if found is None or len(found[0].ids) < LEAST_UNASKED:
        return None
    grid, quads = found
    plain, contrast = plain_inside(to_8_bits(gray), quads)
    if plain.mean() < LEAST_SEEN or unevenly_dark(contrast, grid.discs.centre):
        return None
    place = np.c_[grid.ids % grid.columns, grid.ids // grid.columns].astype(float)
    _, jacobian, certain = from_points(place, place, grid.discs.centre)
    area = np.abs(np.linalg.det(jacobian))  # of a cell of the grid, compared with that of its square
    ratio = area / (4 * np.abs(np.linalg.det(grid.discs.shape)))
    spacing = float(np.sqrt(np.median(ratio[certain]))) - 1 if certain.any() else 0.0
    if not GAPS[0] < spacing < GAPS[1]:
        return None
    target = SquareGrid(grid.columns, grid.rows, 1.0, spacing)
    return (grid, spacing) if isinstance(target.find(gray, seconds), Detection) else None


def _ordered(quads: Array, centres: Array, jacobian: Array) -> Array:
    """The corners of each quadrilateral, clockwise from the board's upper left."""
    first = np.einsum("kij,j->ki", jacobian, np.array([-1.0, -1.0]))  # towards the upper left corner
    offset = quads - centres[:, None]
    cosine = (offset * first[:, None]).sum(2) / np.linalg.norm(offset, axis=2)
    order = (cosine.argmax(1)[:, None] + np.arange(4)) % 4
    return np.take_along_axis(quads, order[..., None], 1)


def search(
    gray: Array, seconds: float, size: tuple[int, int] | None
) -> tuple[tuple[Grid, Array] | None, list[Grid]]:
    """Search for a grid of separate squares from coarse to fine.

    Parameters
    ----------
    gray : (height, width) uint8 or uint16 array
    seconds : float
    size : (columns, rows) or None
        None for any size.

    Returns
    -------
    found : (Grid, (K, 4, 2) array) or None
        The grid and its squares' outlines, in px of the full picture.
    others : list of Grid
        The grids that were seen, if none was as requested.
    """
    began, picture = clock(), to_8_bits(gray)
    others: list[Grid] = []
    for factor in reductions(picture.shape):
        start = clock()
        quads = (find_squares(reduced(picture, factor)) + 0.5) * factor - 0.5
        if len(quads) >= LEAST_POINTS:
            discs = as_discs(quads)
            grid, seen = find_board(discs, False, size, factor)
            if grid is not None:
                rows = [int(np.abs(discs.centre - c).sum(1).argmin()) for c in grid.discs.centre]
                return (grid, quads[rows]), others
            others += seen
        if not time_for_next(clock() - start, seconds - (clock() - began)):
            break
    return None, others
