"""Alternating black and white squares: agreement between the grey values of a picture and a grid of corners."""

from __future__ import annotations

import cv2
import numpy as np

from camcal.detect.candidates import Candidates
from camcal.detect.grid import Marks
from camcal.detect.lattice import Lattice, predicted
from camcal.geometry.neighbours import Neighbours
from camcal.geometry.numbers import median
from camcal.records import dataclass

Array = np.ndarray

#: of a square; largest distance of a missing corner from its prediction. Neighbouring corners are 1 away, saddles on a
#: blurred edge between them .5
REACH = 0.25
ROUNDS = 6  #: of completing a grid: at most so many rows may be missing on one side
CLEAR = 0.4  #: least contrast of an edge, or of another corner, relative to that of the adjacent corners
UNLIKE = 0.25  #: share of the median difference by which neighbouring squares must differ
#: px; least distance from an edge at which its two sides are sampled, beyond its blur; .3 to 3 px find the same corners
#: of boards with squares of 4 to 12 px
BESIDE_PX = 1.5
BESIDE = 0.17  #: of an edge's length; distance at which its two sides are sampled, before the next edge
MOST_AT_ONCE = 30_000  #: positions sampled at a time; cv2.remap counts rows in 16 bits


@dataclass(frozen=True)
class Squares:
    """Grey values at the centres of the squares of a grid.

    Attributes
    ----------
    value : (rows - 1, columns - 1) array
        NaN where a corner is missing.
    """

    value: Array

    @classmethod
    def of(cls, gray: Array, lattice: Lattice) -> Squares:
        """Sample a float32 picture."""
        uv = lattice.uv
        centre = 0.25 * (uv[:-1, :-1] + uv[1:, :-1] + uv[:-1, 1:] + uv[1:, 1:])
        known = np.isfinite(centre[..., 0])
        value = np.full(known.shape, np.nan)
        value[known] = _sample(gray, centre[known])
        return cls(value)

    @property
    def sign(self) -> float:
        """The median of the squares with the parity of the first minus that of the others, grey levels.

        Negative if the square between corners (0, 0) and (1, 1) is black; 0 if there is nothing to compare.
        """
        even = np.indices(self.value.shape).sum(0) % 2 == 0
        known = np.isfinite(self.value)
        one, other = self.value[known & even], self.value[known & ~even]
        return median(one) - median(other) if len(one) and len(other) else 0.0

    def alternation(self) -> float:
        """The fraction of neighbouring squares that alternate as on a checkerboard."""
        value = (
            self.value * np.where(np.indices(self.value.shape).sum(0) % 2 == 0, 1, -1) * np.sign(self.sign)
        )
        steps = np.concatenate([(value[:, :-1] + value[:, 1:]).ravel(), (value[:-1] + value[1:]).ravel()])
        known = steps[np.isfinite(steps)]
        usual = median(known) if len(known) else 0.0
        return float((known > UNLIKE * usual).mean()) if usual > 0 else 0.0


def _sample(gray: Array, at: Array) -> Array:
    """Grey values at positions (..., 2), px, by linear interpolation."""
    if not at.size:
        return np.zeros(at.shape[:-1])
    flat = at.reshape(-1, 1, 2).astype(np.float32)
    parts = np.array_split(flat, len(flat) // MOST_AT_ONCE + 1)
    value = [cv2.remap(gray, p, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) for p in parts]
    return np.concatenate(value).reshape(at.shape[:-1]).astype(float)


def shown_edges(gray: Array, marks: Marks, i: Array, ray: Array, j: Array) -> Array:
    """Return whether the picture is brighter on the correct side all along the edges from corners i to corners j, (L,).

    Parameters
    ----------
    gray : (height, width) float32 array
    marks : Marks
        Corners; the sector that follows an even ray is bright.
    i, ray, j : (L,) int arrays
    """
    start, step = marks.xy[i], marks.xy[j] - marks.xy[i]
    length = np.linalg.norm(step, axis=1, keepdims=True)
    normal = np.c_[-step[:, 1], step[:, 0]] / length  # clockwise from the step, y points down
    side = np.maximum(BESIDE_PX, BESIDE * length) * normal
    along = start[:, None] + np.linspace(0.2, 0.8, 5)[None, :, None] * step[:, None]
    bright, dark = _sample(gray, np.stack([along + side[:, None], along - side[:, None]]))
    difference = (bright - dark) * np.where(ray % 2 == 0, 1, -1)[:, None]
    contrast = np.minimum(marks.size[i], marks.size[j])
    return (difference > CLEAR * contrast[:, None]).all(1)


def complete(gray: Array, lattice: Lattice, found: Candidates) -> Lattice:
    """Search for missing corners inside the grid and one step outside it.

    Each is predicted from its neighbours, and accepted if a saddle lies near the prediction and the four squares
    around it alternate correctly.

    Parameters
    ----------
    gray : (height, width) float32 array
    lattice : Lattice
    found : Candidates
        Candidates in the picture.
    """
    sign = Squares.of(gray, lattice).sign
    if not sign:
        return lattice
    tree, origin = Neighbours(found.weak), 0  # parity of the original first corner
    lattice = lattice.padded(1, 1, 1, 1)
    for _ in range(ROUNDS):
        present = lattice.present
        row, col = np.nonzero(~present)
        guess, steps = predicted(lattice.uv, row, col), lattice.steps()[row, col]
        known = np.isfinite(guess).all(1) & np.isfinite(steps).all((1, 2))
        row, col, guess, steps = row[known], col[known], guess[known], steps[known]
        side = np.linalg.norm(steps, axis=2).min(1)
        distance, nearest = tree.query(guess)
        near = distance < REACH * side
        row, col, steps, at = row[near], col[near], steps[near], found.weak[nearest[near]]
        contrast = _corner_contrast(gray, at, steps) * np.where((row + col) % 2 == origin, 1, -1)
        good = contrast * np.sign(sign) > CLEAR * abs(sign)
        if not good.any():
            break
        lattice.uv[row[good], col[good]] = at[good]
        present = lattice.present
        rim = [int(side.any()) for side in (present[0], present[-1], present[:, 0], present[:, -1])]
        origin = (origin + rim[0] + rim[2]) % 2
        lattice = lattice.padded(*rim)
    rows, cols = np.flatnonzero(present.any(1)), np.flatnonzero(present.any(0))
    return Lattice(lattice.uv[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1])


def _corner_contrast(gray: Array, uv: Array, steps: Array) -> Array:
    """The brightness of the squares at the lower right and upper left minus that of the other two; 0 if unclear."""
    a, b = 0.3 * steps[..., 0, :], 0.3 * steps[..., 1, :]
    values = _sample(gray, np.stack([uv + a + b, uv - a - b, uv + a - b, uv - a + b]))
    plus, minus = values[:2], values[2:]
    up, down = plus.min(0) - minus.max(0), plus.max(0) - minus.min(0)
    return np.where(up > 0, up, np.where(down < 0, down, 0.0))


def oriented(gray: Array, lattice: Lattice, columns: int, rows: int) -> Lattice | None:
    """Rotate a grid so that it has the requested columns and rows and its first outer square is black.

    If more than one orientation remains, the one whose columns are closest to the u axis of the picture is chosen: a
    board whose sides are both odd or both even looks the same after half a turn. None if the size does not
    match.
    """
    ways = [w for w in map(lattice.turned, range(4)) if w.size == (columns, rows)]
    black_first = [w for w in ways if Squares.of(gray, w).sign < 0]
    return max(black_first or ways, key=lambda w: w.rightward, default=None)
