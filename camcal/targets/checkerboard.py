"""The checkerboard: its points are the inner corners, where four squares meet."""

from __future__ import annotations

import numpy as np

from camcal.errors import UsageError
from camcal.targets import saddle
from camcal.targets.base import DEFAULT_SECONDS, Detection, Miss, Pattern, Target, parse_grid, parse_length
from camcal.targets.lattice import Lattice, oriented
from camcal.targets.local_map import board_from_corners
from camcal.targets.search import Found, reduce, search
from camcal.targets.smear import edge_blurs, smear

Array = np.ndarray

LEAST_GOOD = 0.5  #: share of the corners that must stand the fit


class Checkerboard(Target):
    """A board of `columns` x `rows` inner corners; its first (top left) square is black.

    Point 0 touches that square, so that a board of one odd and one even side has one orientation only;
    other boards are turned so that the columns run as nearly to the right of the picture as they can.
    """

    kind = "checkerboard"
    point_kind = "saddle"

    def find(self, gray: Array, seconds: float = DEFAULT_SECONDS) -> Detection | Miss:
        """Find the board; see `Target.find`."""
        found = search(gray, seconds, (self.columns, self.rows))
        return found if isinstance(found, Miss) else detection(gray, found, self.columns, self.rows)

    def pattern(self) -> Pattern:
        """Black squares; half a square of white around them."""
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
        """`checkerboard:9x6` or `checkerboard:9x6:25mm`."""
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
        Whether the picture shows the board's end on all sides, so that the size is certain.
    detection : Detection
        With the ids of a board of that size.
    """
    found = search(gray, seconds)
    if isinstance(found, Miss):
        return found
    columns, rows = sorted(found.lattice.size, reverse=True)
    result = detection(gray, found, columns, rows)
    return result if isinstance(result, Miss) else ((columns, rows), found.whole, result)


def detection(gray: Array, found: Found, columns: int, rows: int) -> Detection | Miss:
    """Turn a found grid the right way and fit its corners at full size."""
    coarse = reduce(gray, max(1.0, max(gray.shape) / 640))
    factor = gray.shape[1] / coarse.shape[1]
    turned = oriented(coarse, found.lattice.scaled(1 / factor), columns, rows)
    if turned is None:
        raise ValueError(f"a grid of {found.lattice.size} cannot be numbered as {columns}x{rows}")
    lattice = turned.scaled(factor)
    if found.factor > 1.5:
        lattice = _fit_reduced(gray, lattice, found.factor)
    ids, corners, reasons = sharp_corners(gray, lattice, max(saddle.START_BLUR, 0.25 * found.factor))
    everywhere = range(columns * rows)
    rejected = {i: reasons.get(i, "not seen") for i in everywhere if i not in set(ids.tolist())}
    if len(ids) < max(4, LEAST_GOOD * columns * rows):
        return _unusable(rejected)
    steps = lattice.steps().reshape(-1, 2, 2)[ids]
    scale = 255 / saddle.white_level(gray)
    info = {
        "rejected": rejected,
        "square_px": float(np.median(np.linalg.norm(steps, axis=2))),
        "blur_px": float(np.median(corners.blur)),
        "contrast": float(np.median(corners.contrast) * scale),
        "noise": float(np.median(corners.noise) * scale),
        "covariance": corners.covariance,
    }
    smeared = smear(*edge_blurs(gray, corners, steps))
    if smeared is not None:
        info["smear"] = smeared
    return Detection(ids, corners.uv, corners.sigma, info)


def sharp_corners(gray: Array, lattice: Lattice, blur: float) -> tuple[Array, saddle.Corners, dict[int, str]]:
    """Fit the corners of a grid: first each for itself, then with what they tell of each other.

    Returns
    -------
    ids : (N,) int array
    corners : Corners
        The good ones, in the order of `ids`.
    reasons : dict
        Why the others were rejected, by id.
    """
    ids = np.flatnonzero(lattice.usable.ravel())
    rejected: dict[int, str] = {}
    sides = lattice.steps().reshape(-1, 2, 2)
    corners = saddle.refine(gray, lattice.uv.reshape(-1, 2)[ids], sides[ids], blur=blur)
    for again in (True, False):
        rejected |= {int(i): r for i, r in zip(ids, corners.reasons, strict=True) if r}
        ids, corners = ids[corners.good], corners.take(corners.good)
        if not again or len(ids) < 4:
            break
        uv = np.full((lattice.uv.shape[0] * lattice.uv.shape[1], 2), np.nan)
        uv[ids] = corners.uv
        corners = saddle.sharpen(gray, corners, sides[ids], board_from_corners(uv.reshape(lattice.uv.shape)))
    return ids, corners, rejected


def _unusable(rejected: dict[int, str]) -> Miss:
    """What to say of a grid whose corners do not stand the fit."""
    reasons = list(rejected.values())
    commonest = max(set(reasons), key=reasons.count)
    reason = {"blurred away": "too-blurred", "too little contrast": "too-dark"}.get(commonest, "none")
    words = f"{len(rejected)} corners of the board cannot be used: {commonest}"
    return Miss(reason, words if reason != "none" else "no checkerboard was found")


def _fit_reduced(gray: Array, lattice: Lattice, factor: float) -> Lattice:
    """Bring the corners to a fraction of a px of the picture, by a fit on the reduced one."""
    reduced = reduce(gray, factor)
    small = lattice.scaled(reduced.shape[1] / gray.shape[1])
    usable = small.usable
    corners = saddle.refine(reduced, small.uv[usable], small.steps()[usable])
    uv = small.uv.copy()
    uv[usable] = np.where(corners.good[:, None], corners.uv, uv[usable])
    return Lattice(uv).scaled(gray.shape[1] / reduced.shape[1])
