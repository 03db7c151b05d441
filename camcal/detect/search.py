"""Look for a checkerboard from coarse to fine; most are found on a third of a megapixel."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from camcal.detect import grid, lattice
from camcal.detect.candidates import find_candidates
from camcal.detect.lattice import Lattice
from camcal.detect.targets.base import Miss, clock

Array = np.ndarray

LONG_SIDES = (400, 800, 250, 1600, 2400)  #: px; what the picture is reduced to at most, in the order of trial
ENLARGED = 1000  #: px; a picture of no longer side is enlarged twice at last, for squares of a few px
SLOWER = 2.0  #: how much longer a pixel may take than at the level before
LEAST_PIXELS = 16  #: to each side; a smaller picture is not looked at
LEAST_SIDE = 3  #: corners; a smaller grid is no board
ENOUGH = 0.8  #: share of a board's corners that must be seen
HALF_HIDDEN = 0.7  #: stray corners, as a share of the shorter side, that are more than chance
ALTERNATING = 0.9  #: share of the neighbouring squares that must differ as black and white
BACKGROUND = (
    0.1  #: of the area of the largest grid; a smaller one is what a screen behind it shows, or chance
)
NEARLY_ALL = 0.75  #: share of the corners of a side that shows where the board ends


@dataclass(frozen=True)
class Found:
    """A grid in a picture.

    Attributes
    ----------
    lattice : Lattice
        In px of the full picture.
    factor : float
        How many px of the picture are one px of the reduced picture it was found on: its error is a share
        of that.
    open_ended : bool
        Whether the board may go on beyond the picture's border, or beyond a row that is half hidden.
    picture : (H, W) float32 array
        The reduced picture.
    """

    lattice: Lattice
    factor: float
    open_ended: bool
    picture: Array

    @property
    def whole(self) -> bool:
        """Whether the size is certain: nearly all corners are there and the board does not go on."""
        present = self.lattice.present
        edges = (present[0], present[-1], present[:, 0], present[:, -1])
        full = present.mean() >= NEARLY_ALL and min(e.mean() for e in edges) >= NEARLY_ALL
        return bool(full) and not self.open_ended


def search(gray: Array, seconds: float, size: tuple[int, int] | None = None) -> Found | Miss:
    """Find the largest grid of a picture, or one of a given size.

    Parameters
    ----------
    gray : (height, width) uint8 or uint16 array
    seconds : float
        Time it may take; a level that may not fit into it is left out.
    size : (columns, rows), optional
        Either way round.
    """
    began = clock()
    rate, best, in_time = 0.0, None, True
    for factor in levels(gray.shape):
        pixels = gray.size / factor**2
        spent = clock() - began
        if rate and spent + SLOWER * rate * pixels > seconds:
            in_time = False
            continue
        reduced = reduce(gray, factor)
        level = _at_level(reduced, factor, size)
        for found in level[: 1 if size is None else None]:
            if _fits(found, size) and not _in_the_background(found, level[0]):
                return found
            if best is None or found.lattice.present.sum() > best.lattice.present.sum():
                best = found
        rate = (clock() - began - spent) / pixels
    return _verdict(gray, best, size, in_time, seconds)


def levels(shape: tuple[int, ...]) -> list[float]:
    """Factors by which the picture is reduced, in the order of trial."""
    longest = max(shape)
    factors = [float(max(1, longest // side)) for side in LONG_SIDES] + [0.5] * (longest <= ENLARGED)
    return list(dict.fromkeys(f for f in factors if min(shape) / f >= LEAST_PIXELS))


def reduce(gray: Array, factor: float) -> Array:
    """A picture smaller by a whole factor (or, below 1, larger): float32, values of about 0 to 255."""
    height, width = (int(n / factor) for n in gray.shape)
    if factor > 1:  # cut to whole multiples, so that the factor holds exactly
        gray = gray[: int(height * factor), : int(width * factor)]
    if factor != 1:
        interpolation = cv2.INTER_AREA if factor > 1 else cv2.INTER_CUBIC
        gray = cv2.resize(gray, (width, height), interpolation=interpolation)
    scale = 255.0 / max(float(gray.max()), 1.0) if gray.dtype == np.uint16 else 1.0
    return gray.astype(np.float32) * np.float32(scale)


def _at_level(reduced: Array, factor: float, size: tuple[int, int] | None) -> list[Found]:
    """The grids of one reduced picture, the one that covers most of it first."""
    candidates = find_candidates(reduced)
    pieces = grid.grow(*grid.neighbours(reduced, candidates))
    least = 1 if size is None else 0.4 * size[0] * size[1]
    found = []
    for piece in [p for p in pieces if len(p) >= least][:4]:
        full = lattice.complete(reduced, lattice.from_piece(piece, candidates.xy), candidates.weak)
        cut = lattice.trimmed(full)
        if min(cut.size) < LEAST_SIDE - (size is not None):
            continue
        if lattice.alternation(reduced, cut) < ALTERNATING:
            continue
        goes_on = _open_ended(cut, reduced.shape) or _half_rows(full, cut)
        found.append(Found(cut.scaled(factor), factor, goes_on, reduced))
    return sorted(found, key=lambda f: -_area(f.lattice))


def _area(found: Lattice) -> float:
    """px² that the grid covers: what hangs in front counts, not its image on a screen behind."""
    step = found.steps()[found.usable]
    if not len(step):
        return 0.0
    square = step[:, 0, 0] * step[:, 1, 1] - step[:, 0, 1] * step[:, 1, 0]
    return float(found.present.sum() * abs(np.median(square)))


def _in_the_background(found: Found, largest: Found) -> bool:
    """Whether a grid is so much smaller than another whole one that it is no board held up to the camera."""
    return largest.whole and _area(found.lattice) < BACKGROUND * _area(largest.lattice)


def _open_ended(found: Lattice, shape: tuple[int, ...]) -> bool:
    """Whether the next row beyond some side of the grid would lie (mostly) outside the picture."""
    uv = found.uv
    height, width = shape
    for edge, inner in ((uv[0], uv[1]), (uv[-1], uv[-2]), (uv[:, 0], uv[:, 1]), (uv[:, -1], uv[:, -2])):
        beyond = 2 * edge - inner
        beyond = beyond[np.isfinite(beyond[:, 0])]
        out = ((beyond < 2) | (beyond > np.array([width - 3, height - 3]))).any(1)
        if len(beyond) and out.mean() > 0.3:
            return True
    return False


def _half_rows(full: Lattice, cut: Lattice) -> bool:
    """Whether a row was cut off that is too full to be chance: the board may go on there, hidden."""
    extra = full.present.sum() - cut.present.sum()
    return bool(extra > HALF_HIDDEN * min(cut.size))


def _fits(found: Found, size: tuple[int, int] | None) -> bool:
    if size is None:
        return found.whole
    same = sorted(found.lattice.size) == sorted(size)
    return same and bool(found.lattice.present.mean() >= ENOUGH)


def _verdict(
    gray: Array, best: Found | None, size: tuple[int, int] | None, in_time: bool, seconds: float
) -> Found | Miss:
    """What to say when no level brought just what was looked for."""
    if best is not None and size is None and best.lattice.present.mean() >= ENOUGH:
        return best
    if best is not None and size is not None:
        columns, rows = sorted(best.lattice.size, reverse=True)
        wanted = f"{size[0]}x{size[1]}"
        seen = int(best.lattice.present.sum())
        if best.open_ended and seen < size[0] * size[1]:
            return Miss(
                "cut-off", f"the board leaves the picture: {seen} of {size[0] * size[1]} corners are seen"
            )
        if (columns, rows) == tuple(sorted(size, reverse=True)):
            return Miss("cut-off", f"only {best.lattice.present.mean():.0%} of the {wanted} corners are seen")
        words = f"the picture shows a board of {columns}x{rows} corners, not {wanted}"
        return Miss("other-size", words, {"size": (columns, rows)})
    if not in_time:
        return Miss("time", f"no board was found within {seconds:g} s")
    return _why_nothing(gray)


def _why_nothing(gray: Array) -> Miss:
    """The plainest reason why a picture shows no board, as far as it can be told."""
    if min(gray.shape) < LEAST_PIXELS:
        return Miss(
            "too-small", f"the picture has {gray.shape[1]}x{gray.shape[0]} pixels: too small for a board"
        )
    small = reduce(gray, max(1.0, max(gray.shape) // 640))
    low, high = np.percentile(small, (2, 99))
    if high < 30:
        return Miss("too-dark", f"the picture is too dark: 99% of it is below {high:.0f} of 255")
    if low > 240:
        return Miss("too-bright", f"the picture is too bright: 98% of it is above {low:.0f} of 255")
    fine = small - cv2.GaussianBlur(small, (0, 0), 2)
    if np.percentile(np.abs(fine), 99.5) < 0.03 * (high - low):
        return Miss("too-blurred", "the picture is too blurred: it shows no sharp edge")
    return Miss("none", "no checkerboard was found")
