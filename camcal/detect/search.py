"""Coarse-to-fine search for a checkerboard; most are found in a picture of 0.1 megapixels."""

from __future__ import annotations

from functools import partial

import numpy as np

from camcal.detect import grid
from camcal.detect.candidates import find_candidates
from camcal.detect.lattice import Lattice
from camcal.detect.no_board import why_nothing
from camcal.detect.pyramid import as_float, reduced, to_search
from camcal.detect.squares import Squares, complete, shown_edges
from camcal.detect.targets.base import LEAST_SEEN, Miss, clock
from camcal.geometry.numbers import median
from camcal.records import dataclass

Array = np.ndarray

#: px; lengths to which the longer side of the picture is reduced, in the order of trial. 250 and 130 find boards with
#: large, blurred squares, 1600 and 3200 those with small ones
LONG_SIDES = (400, 800, 250, 130, 1600, 3200)
ENLARGED = 1000  #: px; a picture of no longer side is enlarged twice at last, for squares of a few px
SLOWER = 2.0  #: by which the time per pixel may exceed that of the previous level
LEAST_PIXELS = 16  #: along each side; a smaller picture is not searched
SEED = 0.4  #: share of a board's corners that must be linked for the others to be searched
HALF_HIDDEN = 0.7  #: stray corners, as a share of the shorter side, above which they are not chance
ALTERNATING = 0.9  #: share of the neighbouring squares that must differ as black and white
#: of the area of the largest grid; a smaller one is on a screen in the background, or chance
BACKGROUND = 0.1
NEARLY_ALL = 0.75  #: share of the corners of a side that must be found for the board to end there
BORDER = 2  #: px; a corner this close to the border of the picture cannot be detected
BEYOND = 0.3  #: share of a row beyond the board outside the picture for the board possibly to continue there


@dataclass(frozen=True)
class Found:
    """A grid in a picture.

    Attributes
    ----------
    lattice : Lattice
        In px of the full picture.
    factor : float
        Number of px of the picture per px of the reduced picture in which it was found; the error of the
        corners is proportional to it.
    open_ended : bool
        Whether the board may continue beyond the picture's border, or beyond a half-hidden row.
    picture : (H, W) float32 array
        The reduced picture.
    """

    lattice: Lattice
    factor: float
    open_ended: bool
    picture: Array

    @property
    def whole(self) -> bool:
        """Whether the size is certain: nearly all corners are present and the board does not continue."""
        present = self.lattice.present
        edges = (present[0], present[-1], present[:, 0], present[:, -1])
        full = present.mean() >= NEARLY_ALL and min(e.mean() for e in edges) >= NEARLY_ALL
        return bool(full) and not self.open_ended

    @property
    def area(self) -> float:
        """The area of the grid, px²; a board in front is preferred to its image on a screen in the background."""
        steps, present = self.lattice.steps(), self.lattice.present
        step = steps[present & np.isfinite(steps).all((-1, -2))]
        if not len(step):
            return 0.0
        square = step[:, 0, 0] * step[:, 1, 1] - step[:, 0, 1] * step[:, 1, 0]
        return float(present.sum() * abs(median(square)))

    def fits(self, size: tuple[int, int] | None) -> bool:
        """Return whether it is a board of that size (columns, rows), in either orientation; without a size, whether
        it is a whole board.
        """
        if size is None:
            return self.whole
        same = sorted(self.lattice.size) == sorted(size)
        return same and bool(self.lattice.present.mean() >= LEAST_SEEN)


def search(gray: Array, seconds: float, size: tuple[int, int] | None = None) -> Found | Miss:
    """Find the largest grid of a picture, or one of a given size.

    Parameters
    ----------
    gray : (height, width) uint8 or uint16 array
    seconds : float
        Time it may take; a level that may exceed it is skipped.
    size : (columns, rows), optional
        In either orientation.
    """
    began = clock()
    picture, limits = to_search(gray)
    rate, best, in_time = 0.0, None, True
    for factor in levels(gray.shape):
        pixels = gray.size / factor**2
        spent = clock() - began
        if rate and spent + SLOWER * rate * pixels > seconds:
            in_time = False
            continue
        level = _at_level(as_float(reduced(picture, factor), limits), factor, size)
        for found in level[: 1 if size is None else None]:
            if found.fits(size) and not _in_the_background(found, level[0]):
                return found
            if best is None or found.lattice.present.sum() > best.lattice.present.sum():
                best = found
        rate = (clock() - began - spent) / pixels
    if best is None:
        return why_nothing(gray) if in_time else Miss("time", f"no board was found within {seconds:g} s")
    if size is None:
        return best if best.lattice.present.mean() >= LEAST_SEEN else why_nothing(gray)
    return _why_not(best, size)


def levels(shape: tuple[int, ...]) -> list[float]:
    """Reduction factors of the picture, in the order of trial."""
    longest = max(shape)
    factors = [float(max(1, round(longest / side))) for side in LONG_SIDES] + [0.5] * (longest <= ENLARGED)
    return list(dict.fromkeys(f for f in factors if min(shape) / f >= LEAST_PIXELS))


def _at_level(picture: Array, factor: float, size: tuple[int, int] | None) -> list[Found]:
    """The grids of one reduced picture, the largest in area first."""
    candidates = find_candidates(picture)
    links = grid.neighbours(candidates.marks, partial(shown_edges, picture, candidates.marks))
    least = 1 if size is None else SEED * size[0] * size[1]
    found = []
    for piece in [p for p in grid.grow(*links) if (p >= 0).sum() >= least][: grid.MOST_PIECES]:
        full = complete(picture, Lattice.of(piece, candidates.marks.xy), candidates)
        cut = full.trimmed()
        if min(cut.size) < grid.LEAST_SIDE - (size is not None):
            continue
        if Squares.of(picture, cut).alternation() < ALTERNATING:
            continue
        goes_on = _open_ended(cut, picture.shape) or _half_rows(full, cut)
        found.append(Found(cut.scaled(factor), factor, goes_on, picture))
    return sorted(found, key=lambda f: -f.area) if len(found) > 1 else found


def _in_the_background(found: Found, largest: Found) -> bool:
    """Return whether a grid is so much smaller than another whole one that it is not the board held in front of
    the camera.
    """
    return found is not largest and largest.whole and found.area < BACKGROUND * largest.area


def _open_ended(found: Lattice, shape: tuple[int, ...]) -> bool:
    """Return whether the next row beyond some side of the grid would lie mostly outside the picture."""
    uv = found.uv
    last = np.array(shape[::-1]) - 1 - BORDER
    for edge, inner in ((uv[0], uv[1]), (uv[-1], uv[-2]), (uv[:, 0], uv[:, 1]), (uv[:, -1], uv[:, -2])):
        beyond = 2 * edge - inner
        beyond = beyond[np.isfinite(beyond[:, 0])]
        out = ((beyond < BORDER) | (beyond > last)).any(1)
        if len(beyond) and out.mean() > BEYOND:
            return True
    return False


def _half_rows(full: Lattice, cut: Lattice) -> bool:
    """Return whether a trimmed row has too many points to be chance, so that the board may continue there, hidden."""
    extra = full.present.sum() - cut.present.sum()
    return bool(extra > HALF_HIDDEN * min(cut.size))


def _why_not(best: Found, size: tuple[int, int]) -> Miss:
    """The reason why a grid is not the requested board."""
    wanted, seen, total = f"{size[0]}x{size[1]}", int(best.lattice.present.sum()), size[0] * size[1]
    columns, rows = sorted(best.lattice.size, reverse=True)
    if best.open_ended and seen < total:
        return Miss("cut-off", f"the board extends beyond the picture: {seen} of {total} corners are visible")
    if (columns, rows) == tuple(sorted(size, reverse=True)):
        return Miss("cut-off", f"only {best.lattice.present.mean():.0%} of the {wanted} corners are visible")
    words = f"the picture shows a board of {columns}x{rows} corners, not {wanted}"
    if columns <= max(size) and rows <= min(size):
        words += ", or its outer rows are covered"
    return Miss("other-size", words, {"size": (columns, rows)})
