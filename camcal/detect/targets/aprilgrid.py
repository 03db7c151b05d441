"""AprilTag grids as printed by Kalibr: tags in rows, and a small black square at each crossing of the gaps.

`aprilgrid:6x6:22mm:0.3` has 6x6 tags of 22 mm with gaps of 0.3 of that; `aprilgrid:FILE.yaml` reads Kalibr's
file, with lengths in metres. Tag 0 is at the lower left; ids increase to the right, then up. `family=t36h11`,
`border=2` and `start=0` (id of the first tag) may follow. The frame is camcal's, x to the right and y down, with
its origin at the upper left corner of the upper left tag. Point 4 k + c is corner c of the k-th tag, counted
counter-clockwise from the lower left, as in Kalibr. Each point is the saddle between a tag and a small square.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from camcal.detect.targets.base import Pattern, check_arguments, not_usual, ratio, whole_number
from camcal.detect.targets.dictionaries import (
    black_cells,
    dictionary,
    find_name,
    marker_count,
    rectangle,
    rectangles,
)
from camcal.detect.targets.tag_board import TagBoard
from camcal.errors import DataError, UsageError
from camcal.settings.sizes import parse_grid, parse_length
from camcal.system.documents import LARGEST, parse_yaml
from camcal.system.reading import read_text

Array = np.ndarray

EXAMPLE = "aprilgrid:6x6:22mm:0.3"
#: of a tag's side, of a grid that was not named: at 1 the squares in the gaps are as large as the tags
LARGEST_GAP = 0.95
#: corners of a unit square, counter-clockwise from the lower left with y downward
CORNERS = np.array([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]])
#: which of them are cv2's corners 0 to 3: Kalibr prints tags rotated by 180 degrees relative to cv2
CV2_CORNERS = np.array([1, 0, 3, 2])


class AprilGrid(TagBoard):
    """A grid of `columns` x `rows` tags; `square` is a tag's side, `spacing` the gap as a fraction of it."""

    kind = "aprilgrid"
    first_half = second_half = 0.85  # of a small square, whose edges do not continue beyond it

    def __init__(
        self,
        columns: int,
        rows: int,
        square: float = 1.0,
        spacing: float = 0.3,
        unit: str = "square",
        dictionary: str = "APRILTAG_36h11",
        border: int = 2,
        start: int = 0,
    ):
        super().__init__(columns, rows, square, unit)
        self.spacing, self.dictionary = float(spacing), dictionary
        self.border, self.start = int(border), int(start)
        held = marker_count(dictionary)
        if not 0 < self.spacing < 1:
            raise UsageError(
                f"a spacing of {spacing:g} cannot be printed.", "It is a fraction of the tag's side: 0.3"
            )
        if self.start < 0 or self.start + columns * rows > held:
            raise UsageError(
                f"tags {start} to {start + columns * rows - 1} are needed; {dictionary} holds {held}.",
                "Use a smaller grid or another family.",
            )

    @property
    def pitch(self) -> float:
        """The distance between neighbouring tags."""
        return self.square * (1 + self.spacing)

    @property
    def _origins(self) -> Array:
        """Upper left corners (K, 2) of the tags, in the order of their ids."""
        column, up = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        return np.c_[column.ravel(), (self.rows - 1 - up).ravel()] * self.pitch

    @property
    def points(self) -> Array:
        """The corners of all tags (4 K, 3)."""
        corners = self._origins[:, None] + self.square * CORNERS
        return np.c_[corners.reshape(-1, 2), np.zeros(4 * self.columns * self.rows)]

    @property
    def tag_ids(self) -> Array:
        """Ids of the tags (K,)."""
        return self.start + np.arange(self.columns * self.rows)

    @property
    def tag_corners(self) -> Array:
        """Corners of the tags (K, 4, 2) in cv2's order."""
        return self._origins[:, None] + self.square * CORNERS[CV2_CORNERS]

    @property
    def cell(self) -> float:
        """The side of a small square, the length of its edges."""
        return self.square * self.spacing

    @property
    def clear(self) -> float:
        """The distance to the bits inside the tag's black border, or to the opposite edge of the small square."""
        cells = dictionary(self.dictionary).markerSize + 2 * self.border
        return self.square * min(self.spacing, self.border / cells)

    def pattern(self) -> Pattern:
        """Tags and small squares, with a margin of one gap beyond the squares."""
        gap, shapes = self.square * self.spacing, []
        for tag, origin in zip(self.tag_ids, self._origins, strict=True):
            black = black_cells(self.dictionary, int(tag), self.border)[::-1, ::-1]
            shapes += rectangles(black, origin, self.square)
        for j in range(self.rows + 1):
            for i in range(self.columns + 1):
                x, y = i * self.pitch - gap, j * self.pitch - gap
                shapes.append(rectangle(x, y, x + gap, y + gap))
        extent = (-2 * gap, -2 * gap, self.columns * self.pitch + gap, self.rows * self.pitch + gap)
        return Pattern(tuple(shapes), np.zeros((0, 3)), extent)

    @classmethod
    def parse(cls, arguments: list[str], named: dict[str, str]) -> AprilGrid:
        """Read `6x6:22mm:0.3` or the name of Kalibr's file.

        Raises
        ------
        UsageError
            If an argument is missing, unknown or out of range.
        DataError
            If the file cannot be read or describes another target.
        """
        from_file = len(arguments) == 1 and arguments[0].lower().endswith((".yaml", ".yml"))
        plain = EXAMPLE.split(":")[1:] if from_file else arguments
        takes = "a Kalibr target file, or tags, their side and the spacing"
        check_arguments("aprilgrid", takes, plain, named, ("family", "border", "start"), EXAMPLE)
        if from_file:
            columns, rows, square, spacing = read_kalibr(Path(arguments[0]))
            unit = "m"
        else:
            (columns, rows), (square, unit) = parse_grid(arguments[0]), parse_length(arguments[1])
            spacing = ratio(arguments[2], "the spacing", EXAMPLE)
        family = find_name(named.get("family", "t36h11"))
        border, start = (whole_number(named.get(k, d), k) for k, d in (("border", "2"), ("start", "0")))
        return cls(columns, rows, square, spacing, unit, family, border, start)

    def _arguments(self) -> list[str]:
        plain = [self._length(self.square), f"{self.spacing:.4g}"]
        family = ("family", self.dictionary, "APRILTAG_36h11")
        return plain + not_usual([family, ("border", self.border, 2), ("start", self.start, 0)])

    def describe(self) -> dict[str, Any]:
        """The report's entry `target`."""
        own = {"spacing": self.spacing, "family": self.dictionary, "border": self.border, "start": self.start}
        return super().describe() | own


def read_kalibr(path: Path) -> tuple[int, int, float, float]:
    """Read Kalibr's description of a target: columns, rows, side of a tag (m), spacing.

    Raises
    ------
    DataError
        If the file is missing, is not YAML, or does not describe an aprilgrid.
    """
    needed = "Kalibr's file is needed: target_type, tagCols, ..."
    found = parse_yaml(read_text(path, LARGEST, "Kalibr's description of a target", needed), path)
    kind = found.get("target_type") if isinstance(found, dict) else None
    if kind != "aprilgrid":
        raise DataError(f"{path} describes {kind or 'no target'}.", "target_type: 'aprilgrid' is needed.")
    try:
        columns, rows = int(found["tagCols"]), int(found["tagRows"])
        square, spacing = float(found["tagSize"]), float(found["tagSpacing"])
    except KeyError as error:
        raise DataError(
            f"{path} lacks {error.args[0]}.", "tagCols, tagRows, tagSize, tagSpacing are needed."
        ) from None
    except (TypeError, ValueError, OverflowError):
        raise DataError(
            f"{path} holds text where a number is needed.", "tagSize is in metres: 0.022"
        ) from None
    if min(columns, rows) < 1 or not 0 < square < np.inf:
        raise DataError(
            f"{path}: a grid of {columns}x{rows} tags of {square:g} m.", "All values must be positive."
        )
    return columns, rows, square, spacing
