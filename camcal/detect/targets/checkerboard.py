"""The checkerboard: its points are the inner corners, where four squares meet."""

from __future__ import annotations

import numpy as np

from camcal.detect.evenness import unevenness
from camcal.detect.grid_fit import LEAST_GOOD, sharp_corners
from camcal.detect.pyramid import grey_span
from camcal.detect.search import Found, search
from camcal.detect.squares import oriented
from camcal.detect.targets.base import (
    DEFAULT_SECONDS,
    LEAST_POINTS,
    LEAST_UNASKED,
    Detection,
    Miss,
    Pattern,
    Target,
)
from camcal.errors import UsageError
from camcal.geometry.numbers import median
from camcal.settings.sizes import parse_grid, parse_length

Array = np.ndarray

SURE = 0.75  #: share of the corners of a board of unknown size that must pass the tests of the fit
#: of a step; grids in 300 pages of small text have 0.10 to 0.18. Boards of all real sets have at most 0.06; boards of
#: 5x4 corners close to a 170 degree lens have up to 0.16, so that this alone does not decide
UNEVEN = 0.08
#: of the contrast; residual of the corner fits. In the same text 0.32 to 0.55, on real boards at most 0.29
UNLIKE = 0.3


class Checkerboard(Target):
    """A board of `columns` x `rows` inner corners; its first (top left) square is black.

    Point 0 touches that square, so that a board with one odd and one even side has a unique orientation; for
    other boards the orientation whose columns are closest to the u axis of the picture is chosen.
    """

    kind = "checkerboard"
    point_kind = "saddle"

    def find(self, gray: Array, seconds: float = DEFAULT_SECONDS) -> Detection | Miss:
        """Find the board; see `Target.find`."""
        found = search(gray, seconds, (self.columns, self.rows))
        return found if isinstance(found, Miss) else detection(gray, found, self.columns, self.rows)

    def pattern(self) -> Pattern:
        """Black squares, with half a square of white around them."""
        s = self.square
        square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
        black = [
            (square + (column, row)) * s
            for row in range(-1, self.rows)
            for column in range(-1, self.columns)
            if (row + column) % 2 == 0
        ]
        margin = 1.5
        extent = (-margin * s, -margin * s, (self.columns - 1 + margin) * s, (self.rows - 1 + margin) * s)
        return Pattern(tuple(black), np.zeros((0, 3)), extent)

    @classmethod
    def parse(cls, arguments: list[str], named: dict[str, str]) -> Checkerboard:
        """Read `9x6` or `9x6:25mm`."""
        if not arguments or len(arguments) > 2 or named:
            raise UsageError(
                "a checkerboard is given by its inner corners and the side of a square.",
                "Write checkerboard:9x6:25mm.",
            )
        columns, rows = parse_grid(arguments[0])
        square, unit = parse_length(arguments[1]) if len(arguments) == 2 else (1.0, "square")
        return cls(columns, rows, square, unit)


def find_any(gray: Array, seconds: float = DEFAULT_SECONDS) -> tuple[tuple[int, int], bool, Detection] | Miss:
    """Find a board of unknown size.

    Returns
    -------
    size : (columns, rows), the longer side first
    whole : bool
        Whether the picture shows all four borders of the board, so that its size is certain.
    detection : Detection
        With the ids of a board of that size.
    """
    found = search(gray, seconds)
    if isinstance(found, Miss):
        return found
    columns, rows = sorted(found.lattice.size, reverse=True)
    result = detection(gray, found, columns, rows)
    if isinstance(result, Miss):
        return result
    if len(result) < max(LEAST_UNASKED, SURE * columns * rows):  # windows of a house also form grids of nine
        return Miss("none", "no checkerboard was found")
    return (columns, rows), found.whole, result


def by_chance(found: Detection, columns: int, rows: int) -> bool:
    """Return whether corners are as irregularly placed, and as different from corners of squares, as those in text
    and foliage.
    """
    uv = np.full((columns * rows, 2), np.nan)
    uv[found.point_ids] = found.uv
    unlike = found.info["noise"] > UNLIKE * found.info["contrast"]
    return bool(unlike and unevenness(uv.reshape(rows, columns, 2)) > UNEVEN)


def detection(gray: Array, found: Found, columns: int, rows: int) -> Detection | Miss:
    """Orient a found grid and fit its corners at full size."""
    turned = oriented(found.picture, found.lattice.scaled(1 / found.factor), columns, rows)
    if turned is None:
        raise ValueError(f"a grid of {found.lattice.size} cannot be numbered as {columns}x{rows}")
    lattice = turned.scaled(found.factor)
    ids, corners, reasons = sharp_corners(gray, lattice, found.factor, found.picture)
    everywhere = range(columns * rows)
    rejected = {i: reasons.get(i, "not seen") for i in everywhere if i not in set(ids.tolist())}
    if len(ids) < max(LEAST_POINTS, LEAST_GOOD * columns * rows):
        return _unusable(rejected)
    steps = lattice.steps().reshape(-1, 2, 2)[ids]
    scale = 255 / grey_span(gray)
    info = {
        "rejected": rejected,
        "square_px": median(np.linalg.norm(steps, axis=2)),
        "blur_px": median(corners.blur),
        "contrast": median(corners.contrast) * scale,
        "noise": median(corners.noise) * scale,
        "covariance": corners.covariance,
        "fit": corners.params,
        "sides": steps,
    }
    made = Detection(ids, corners.uv, corners.sigma, info)
    return Miss("none", "no checkerboard was found") if by_chance(made, columns, rows) else made


def _unusable(rejected: dict[int, str]) -> Miss:
    """The reason for a grid whose corners cannot be fitted."""
    reasons = list(rejected.values())
    commonest = max(set(reasons), key=reasons.count)
    reason = {"blurred away": "too-blurred", "too little contrast": "too-dark"}.get(commonest, "none")
    words = f"{len(rejected)} corners of the board cannot be used: {commonest}"
    return Miss(reason, words if reason != "none" else "no checkerboard was found")
