"""ChArUco boards: checkerboards whose white squares hold markers, so that every corner is identified.

`charuco:9x7:40mm:20mm:4X4_100` has 9x7 squares of 40 mm with markers of 20 mm. A further argument `legacy` selects
the layout of OpenCV before 4.6, which differs for an even number of rows; `start=31` is the id of the first marker
(for several boards in a picture). The frame is OpenCV's, with its origin at the outer corner of the upper left
square; point ids are OpenCV's, row by row from 0 over the inner corners.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from camcal.detect.board_points import from_points
from camcal.detect.marked_grid import place_on_board
from camcal.detect.search import search
from camcal.detect.targets.base import (
    DEFAULT_SECONDS,
    Detection,
    Miss,
    Pattern,
    check_arguments,
    clock,
    not_usual,
    whole_number,
)
from camcal.detect.targets.dictionaries import (
    black_cells,
    dictionary,
    find_name,
    marker_count,
    rectangle,
    rectangles,
)
from camcal.detect.targets.tag_board import TagBoard
from camcal.errors import UsageError
from camcal.settings.sizes import parse_grid, parse_length

Array = np.ndarray

EXAMPLE = "charuco:9x7:40mm:20mm:4X4_100"


class Charuco(TagBoard):
    """A ChArUco board of `columns` x `rows` squares."""

    kind = "charuco"

    def __init__(
        self,
        columns: int,
        rows: int,
        square: float = 1.0,
        marker: float = 0.5,
        dictionary: str = "4X4_50",
        unit: str = "square",
        legacy: bool = False,
        start: int = 0,
    ):
        super().__init__(columns, rows, square, unit)
        self.marker, self.dictionary, self.legacy = float(marker), dictionary, legacy
        self.start = int(start)
        needed, held = self.start + columns * rows // 2, marker_count(dictionary)
        if not 0 < self.marker < self.square:
            raise UsageError(
                f"a marker of {marker:g} does not fit in a square of {square:g}.",
                "The square comes first, then the marker, then the dictionary: " + EXAMPLE,
            )
        if needed > held:
            raise UsageError(
                f"a board of {columns}x{rows} needs marker ids up to {needed - 1}; {dictionary} holds {held}.",
                "Use a larger dictionary, such as " + dictionary.split("_")[0] + "_1000.",
            )

    def _board(self) -> Any:
        size = (self.columns, self.rows)
        # lengths in squares: cv2 stores float32, which does not represent 0.04 exactly
        board = cv2.aruco.CharucoBoard(size, 1.0, self.marker / self.square, dictionary(self.dictionary))
        board.setLegacyPattern(self.legacy)
        return board

    @property
    def points(self) -> Array:
        """The inner corners (M, 3), row by row, in cv2's frame."""
        x, y = np.meshgrid(np.arange(1.0, self.columns), np.arange(1.0, self.rows))
        return np.c_[x.ravel(), y.ravel(), np.zeros(x.size)] * self.square

    @property
    def tag_ids(self) -> Array:
        """Ids of the markers (K,)."""
        return self.start + np.asarray(self._board().getIds(), int).ravel()

    @property
    def tag_corners(self) -> Array:
        """Corners of the markers (K, 4, 2), clockwise from the upper left."""
        first = np.asarray([c[0, :2] for c in np.asarray(self._board().getObjPoints())], float)
        cells = np.floor(first)  # the square that holds the marker
        gap = (self.square - self.marker) / 2
        corner = cells * self.square + gap
        return corner[:, None] + self.marker * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])

    @property
    def cell(self) -> float:
        """The side of a square."""
        return self.square

    @property
    def clear(self) -> float:
        """The gap between a square's edges and its marker."""
        return (self.square - self.marker) / 2

    @property
    def pitch(self) -> float:
        """The distance between neighbouring markers along a diagonal."""
        return float(np.sqrt(2)) * self.square

    def find(self, gray: Array, seconds: float = DEFAULT_SECONDS) -> Detection | Miss:
        """Find the board by its markers; if few can be read, by its corners and all of its markers jointly."""
        start = clock()
        found = super().find(gray, seconds)
        if isinstance(found, Detection) and 2 * len(found) >= len(self.points):
            return found
        left = seconds - (clock() - start)
        other = self._by_grid(gray, left) if left > 0 else None
        if other is None or (isinstance(found, Detection) and len(found) >= len(other)):
            return found
        return other

    def _by_grid(self, gray: Array, seconds: float) -> Detection | None:
        seen = search(gray, seconds)
        if isinstance(seen, Miss):
            return None
        codes = np.array([~black_cells(self.dictionary, int(m)) for m in self.tag_ids], float)
        squares = np.floor(self.tag_corners[:, 0] / self.square).astype(int)
        size = (self.columns - 1, self.rows - 1)
        share = self.marker / self.square
        placed = place_on_board(gray, seen.lattice.uv, codes, squares, share, size)
        if placed is None:
            return None
        order = np.argsort(placed[0])
        ids, uv = placed[0][order], placed[1][order]
        points = self.points[:, :2]
        _, jacobian, certain = from_points(points[ids], points[ids], uv)
        found = self.grown(gray, ids[certain], uv[certain], jacobian[certain], {"markers": 0})
        return found if isinstance(found, Detection) else None

    def pattern(self) -> Pattern:
        """Black squares and markers, with a margin of half a square."""
        s, white = self.square, {tuple(c) for c in np.floor(self.tag_corners[:, 0] / self.square).astype(int)}
        cells = [(i, j) for j in range(self.rows) for i in range(self.columns) if (i, j) not in white]
        shapes = [rectangle(i * s, j * s, (i + 1) * s, (j + 1) * s) for i, j in cells]
        for marker, corners in zip(self.tag_ids, self.tag_corners, strict=True):
            shapes += rectangles(black_cells(self.dictionary, int(marker)), corners[0], self.marker)
        extent = (-0.5 * s, -0.5 * s, (self.columns + 0.5) * s, (self.rows + 0.5) * s)
        return Pattern(tuple(shapes), np.zeros((0, 3)), extent)

    @classmethod
    def parse(cls, arguments: list[str], named: dict[str, str]) -> Charuco:
        """Read `9x7:40mm:20mm:4X4_100`, optionally followed by `legacy`.

        Raises
        ------
        UsageError
            If an argument is missing, unknown or inconsistent with the others.
        """
        plain = [a for a in arguments if a.lower() != "legacy"]
        takes = "squares, side, marker and dictionary"
        check_arguments("charuco", takes, plain, named, ("start",), EXAMPLE)
        start = whole_number(named.get("start", "0"), "start")
        (columns, rows), name = parse_grid(plain[0]), find_name(plain[3])
        (square, unit), (marker, other) = parse_length(plain[1]), parse_length(plain[2])
        if unit != other:
            raise UsageError(f"the square is in {unit} and the marker in {other}.", "Give both in one unit.")
        return cls(columns, rows, square, marker, name, unit, len(plain) < len(arguments), start)

    def _arguments(self) -> list[str]:
        lengths = [self._length(self.square), self._length(self.marker), self.dictionary]
        return lengths + ["legacy"] * self.legacy + not_usual([("start", self.start, 0)])

    def scaled(self, square: float, unit: str) -> Charuco:
        """The same board with another side of a square; see `Target.scaled`."""
        made = super().scaled(square, unit)
        assert isinstance(made, Charuco)
        made.marker *= square / self.square
        return made

    def describe(self) -> dict[str, Any]:
        """The report's entry `target`."""
        own = {
            "marker": self.marker,
            "dictionary": self.dictionary,
            "legacy": self.legacy,
            "start": self.start,
        }
        return super().describe() | own
