"""A grid of points as an array of rows and columns: steps, gaps and sparse rows."""

from __future__ import annotations

import numpy as np

from camcal.geometry.numbers import median
from camcal.records import dataclass

Array = np.ndarray

#: share of the usual number of points of a row; an outer row with fewer is not part of the board
SPARSE = 0.5
LEAST_SINE = 0.05  #: of the angle between rows and columns: a board seen at 87 degrees
LEAST_SIDE = 2  #: rows that are always kept


@dataclass(frozen=True)
class Lattice:
    """Points in rows and columns; the turn from columns to rows is clockwise, as on the printed board.

    Attributes
    ----------
    uv : (rows, columns, 2) array
        px; NaN for missing points.
    """

    uv: Array

    @classmethod
    def of(cls, index: Array, xy: Array) -> Lattice:
        """Make a lattice from points xy (N, 2) and the array of `grid.grow`, with an index or -1 at each position."""
        return cls(np.where((index >= 0)[..., None], xy[index], np.nan))

    @property
    def size(self) -> tuple[int, int]:
        """(columns, rows)."""
        return self.uv.shape[1], self.uv.shape[0]

    @property
    def present(self) -> Array:
        """Mask (rows, columns) of the points that were found."""
        return np.isfinite(self.uv[..., 0])

    @property
    def usable(self) -> Array:
        """Mask (rows, columns) of the points with enough neighbours to determine two different directions."""
        steps = self.steps()
        area = np.abs(steps[..., 0, 0] * steps[..., 1, 1] - steps[..., 0, 1] * steps[..., 1, 0])
        return self.present & (area > LEAST_SINE * np.linalg.norm(steps, axis=-1).prod(-1))

    def steps(self) -> Array:
        """Steps (rows, columns, 2, 2) to the next point along columns and rows, px; NaN if unknown.

        From the neighbours of a point itself if at least one is known in that direction; otherwise the mean of the
        steps of the four points around it.
        """
        own = np.stack([_step(self.uv, 1), _step(self.uv, 0)], 2)
        if np.isfinite(own).all():
            return own
        padded = _framed(own, 1, 1, 1, 1)
        around = [padded[1:-1, 2:], padded[1:-1, :-2], padded[2:, 1:-1], padded[:-2, 1:-1]]
        return np.where(np.isfinite(own), own, _mean(np.stack(around)))

    def turned(self, quarters: int) -> Lattice:
        """Return the same points numbered from another corner."""
        return Lattice(np.rot90(self.uv, quarters))

    def scaled(self, factor: float) -> Lattice:
        """Convert to the pixels of a picture that is `factor` times as large."""
        return Lattice((self.uv + 0.5) * factor - 0.5)

    def padded(self, top: int, bottom: int, left: int, right: int) -> Lattice:
        """Add empty rows and columns."""
        return Lattice(_framed(self.uv, top, bottom, left, right))

    def trimmed(self) -> Lattice:
        """Remove the outer rows and columns that hold too few points."""
        return Lattice(self.uv[trim(self.present)])

    @property
    def rightward(self) -> float:
        """The cosine of the angle between the direction of the columns and the u axis of the picture."""
        step = np.nanmean(np.diff(self.uv, axis=1).reshape(-1, 2), axis=0)
        return float(step[0] / np.linalg.norm(step))


def _framed(values: Array, top: int, bottom: int, left: int, right: int) -> Array:
    """Values (rows, columns, ...) with rows and columns of NaN around them; np.pad takes ten times as long."""
    rows, columns = values.shape[:2]
    made = np.full((rows + top + bottom, columns + left + right, *values.shape[2:]), np.nan)
    made[top : top + rows, left : left + columns] = values
    return made


def _step(uv: Array, axis: int) -> Array:
    """The central difference along an axis; one-sided beside a gap or the border."""
    gap = np.full_like(np.take(uv, [0], axis), np.nan)
    difference = np.diff(uv, axis=axis)
    ahead = np.concatenate([difference, gap], axis)
    behind = np.concatenate([gap, difference], axis)
    return np.where(np.isnan(ahead), behind, np.where(np.isnan(behind), ahead, 0.5 * (ahead + behind)))


def _mean(stack: Array) -> Array:
    """The mean over the first axis, ignoring NaN."""
    known = np.isfinite(stack)
    number = known.sum(0)
    total = np.where(known, stack, 0).sum(0)
    return np.where(number > 0, total / np.maximum(number, 1), np.nan)


def predicted(uv: Array, row: Array, column: Array) -> Array:
    """Predicted positions of points, (N, 2) px: the mean over lines and parallelograms of neighbours; NaN without any.

    Parameters
    ----------
    uv : (rows, columns, 2) array
        px; NaN where a point is missing.
    row, column : (N,) int arrays
    """
    padded = _framed(uv, 3, 3, 3, 3)

    def at(down: int, right: int) -> Array:
        return padded[row + 3 + down, column + 3 + right]

    guesses = [0.5 * (at(0, 1) + at(0, -1)), 0.5 * (at(1, 0) + at(-1, 0))]
    for down, right in ((0, 1), (1, 0), (0, -1), (-1, 0)):
        a, b, c = (at(n * down, n * right) for n in (1, 2, 3))
        straight, bent = 2 * a - b, 3 * a - 3 * b + c  # extrapolated from two and from three points
        guesses.append(np.where(np.isnan(bent), straight, 0.5 * (bent + straight)))
    for down, right in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        guesses.append(at(down, 0) + at(0, right) - at(down, right))
    return _mean(np.stack(guesses))


def trim(present: Array) -> tuple[slice, slice]:
    """The rows and columns of a grid that belong to its board, without sparse outer ones.

    Parameters
    ----------
    present : (rows, columns) bool array
    """
    bounds = [[0, present.shape[0]], [0, present.shape[1]]]
    while True:
        part = present[slice(*bounds[0]), slice(*bounds[1])]
        shares = np.ones(
            (2, 2)
        )  # share of the usual number: at the start and the end of the rows and of the columns
        for axis in (0, 1):
            number = part.sum(1 - axis)
            if len(number) > LEAST_SIDE:
                shares[axis] = number[[0, -1]] / max(median(number), 1.0)
        axis, end = divmod(int(shares.argmin()), 2)
        if shares[axis, end] >= SPARSE:
            return slice(*bounds[0]), slice(*bounds[1])
        bounds[axis][end] += -1 if end else 1
