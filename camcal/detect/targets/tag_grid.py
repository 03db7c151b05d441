"""Separate markers in rows, as printed by cv2.aruco.GridBoard: `aruco-grid:5x7:40mm:0.25:4X4_50`.

COLUMNSxROWS markers of the given side; the gap between them is a fraction of it. The first marker (`start`, 0 by
default) is at the upper left; ids increase to the right, then down. Point 4 k + c is corner c of the k-th marker,
clockwise from the upper left. The origin is the upper left corner of the first marker.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from camcal.detect.targets import outlined
from camcal.detect.targets.base import (
    Detection,
    Miss,
    Pattern,
    check_arguments,
    checked_gap,
    not_usual,
    ratio,
    whole_number,
)
from camcal.detect.targets.dictionaries import (
    black_cells,
    dictionary,
    find_name,
    marker_count,
    rectangles,
)
from camcal.detect.targets.tag_board import TagBoard
from camcal.errors import UsageError
from camcal.settings.sizes import parse_grid, parse_length

Array = np.ndarray

EXAMPLE = "aruco-grid:5x7:40mm:0.25:4X4_50"
UNIT = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])  #: corners of a marker, as cv2 finds them
#: factor by which profiles extend beyond half the distance to the bits inside the border: to 0.63 of its width, which
#: leaves a third of it, 1.3 px in the smallest markers, for the blur of the bits
FARTHER = 1.4
LEAST_MARKERS = 2  #: a single one may belong to another object


class TagGrid(TagBoard):
    """A grid of `columns` x `rows` markers; `square` is a marker's side, `spacing` the gap as a fraction of it."""

    kind = "aruco-grid"
    point_kind = "corner"

    def __init__(
        self,
        columns: int,
        rows: int,
        square: float = 1.0,
        spacing: float = 0.25,
        dictionary: str = "4X4_50",
        unit: str = "square",
        border: int = 1,
        start: int = 0,
    ):
        super().__init__(columns, rows, square, unit)
        self.spacing, self.dictionary = checked_gap(spacing, "0.25"), dictionary
        self.border, self.start = int(border), int(start)
        held = marker_count(dictionary)
        if self.start < 0 or self.start + columns * rows > held:
            raise UsageError(
                f"markers {start} to {start + columns * rows - 1} are needed; {dictionary} holds {held}.",
                "Use a smaller grid or a larger dictionary.",
            )

    @property
    def pitch(self) -> float:
        """The distance between neighbouring markers."""
        return self.square * (1 + self.spacing)

    @property
    def tag_ids(self) -> Array:
        """Ids of the markers (K,)."""
        return self.start + np.arange(self.columns * self.rows)

    @property
    def tag_corners(self) -> Array:
        """Corners of the markers (K, 4, 2) in cv2's order."""
        column, row = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        origins = np.c_[column.ravel(), row.ravel()] * self.pitch
        return origins[:, None] + self.square * UNIT

    @property
    def points(self) -> Array:
        """The corners of all markers (4 K, 3)."""
        corners = self.tag_corners.reshape(-1, 2)
        return np.c_[corners, np.zeros(len(corners))]

    @property
    def cell(self) -> float:
        """The side of a marker, the length of its edges."""
        return self.square

    @property
    def clear(self) -> float:
        """The distance to the bits inside the black border, or to the next marker."""
        return self.square * min(self.spacing, self._border_share)

    @property
    def _border_share(self) -> float:
        """The width of the black border as a fraction of the side."""
        return self.border / (dictionary(self.dictionary).markerSize + 2 * self.border)

    def _at_size(self, gray: Array, picture: Array, factor: float) -> Detection | Miss:
        tags, corners = self._markers(picture, factor)
        if len(tags) < LEAST_MARKERS:
            said = "no marker" if not len(tags) else "one marker"
            return Miss(
                "none", f"{said} of {self.dictionary} of this grid was found; {LEAST_MARKERS} are needed"
            )
        room = min(self.spacing, FARTHER * self._border_share)
        fitted, sides = outlined.fit_squares(gray, corners, room, self.tag_corners[tags])
        keep = outlined.in_place(self.points, self.square, tags, fitted)
        if keep.sum() < LEAST_MARKERS:
            return Miss(
                "none", f"{len(tags)} markers were found, but the corners of {keep.sum()} could be fitted"
            )
        count = self.columns * self.rows
        return outlined.detection(gray, count, tags, fitted, keep, sides, {"markers": len(tags)})

    def pattern(self) -> Pattern:
        """The markers, with a margin of one gap around them."""
        margin, shapes = self.square * min(self.spacing, 1.0), []
        for tag, corners in zip(self.tag_ids, self.tag_corners, strict=True):
            shapes += rectangles(black_cells(self.dictionary, int(tag), self.border), corners[0], self.square)
        far = self.tag_corners.reshape(-1, 2).max(0) + margin
        return Pattern(tuple(shapes), np.zeros((0, 3)), (-margin, -margin, float(far[0]), float(far[1])))

    @classmethod
    def parse(cls, arguments: list[str], named: dict[str, str]) -> TagGrid:
        """Read `5x7:40mm:0.25:4X4_50`.

        Raises
        ------
        UsageError
            Where an argument is missing, unknown or out of range.
        """
        takes = "markers, their side, the gap and a dictionary"
        check_arguments("aruco-grid", takes, arguments, named, ("border", "start"), EXAMPLE)
        (columns, rows), (square, unit) = parse_grid(arguments[0]), parse_length(arguments[1])
        spacing = ratio(arguments[2], "the gap", EXAMPLE)
        border, start = (whole_number(named.get(k, d), k) for k, d in (("border", "1"), ("start", "0")))
        return cls(columns, rows, square, spacing, find_name(arguments[3]), unit, border, start)

    def _arguments(self) -> list[str]:
        plain = [self._length(self.square), f"{self.spacing:.4g}", self.dictionary]
        return plain + not_usual([("border", self.border, 1), ("start", self.start, 0)])

    def describe(self) -> dict[str, Any]:
        """The report's entry `target`."""
        own = {
            "spacing": self.spacing,
            "dictionary": self.dictionary,
            "border": self.border,
            "start": self.start,
        }
        return super().describe() | own
