"""A grid of corners as an array: gaps filled, stray rows cut, colours known, turned the right way."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial import cKDTree

Array = np.ndarray

SPARSE = 0.55  #: a row at the edge with less than this share of its corners is not part of the board
REACH = 0.25  #: of a square; how far from its prediction a missing corner may lie


@dataclass(frozen=True)
class Lattice:
    """Corners in rows and columns, turning clockwise from columns to rows as in the printed board.

    Attributes
    ----------
    uv : (rows, columns, 2) array
        px; NaN where the picture shows no corner.
    """

    uv: Array

    @property
    def size(self) -> tuple[int, int]:
        """(columns, rows)."""
        return self.uv.shape[1], self.uv.shape[0]

    @property
    def present(self) -> Array:
        """Which corners were found (rows, columns)."""
        return np.isfinite(self.uv[..., 0])

    @property
    def usable(self) -> Array:
        """Which corners were found with enough neighbours to tell their directions (rows, columns)."""
        return self.present & np.isfinite(self.steps()).all((-1, -2))

    def steps(self) -> Array:
        """Steps (rows, columns, 2, 2) to the next corner along columns and rows, px; NaN if unknown."""
        return _neighbour_steps(self.uv)

    def turned(self, quarters: int) -> Lattice:
        """The same corners numbered from another end."""
        return Lattice(np.rot90(self.uv, quarters))

    def scaled(self, factor: float) -> Lattice:
        """In the pixels of a picture that is `factor` times as large."""
        return Lattice((self.uv + 0.5) * factor - 0.5)


def from_piece(piece: dict[tuple[int, int], int], xy: Array) -> Lattice:
    """Lay the numbered corners of `grid.grow` out as an array."""
    place = np.array(list(piece))
    place -= place.min(0)
    uv = np.full((place[:, 1].max() + 1, place[:, 0].max() + 1, 2), np.nan)
    uv[place[:, 1], place[:, 0]] = xy[list(piece.values())]
    return Lattice(uv)


def _step(uv: Array, axis: int) -> Array:
    """Central difference along an axis; one-sided beside a gap or the edge."""
    gap = np.full_like(np.take(uv, [0], axis), np.nan)
    ahead = np.concatenate([np.diff(uv, axis=axis), gap], axis)
    behind = np.concatenate([gap, np.diff(uv, axis=axis)], axis)
    both = 0.5 * (ahead + behind)
    return np.where(np.isfinite(both), both, np.where(np.isfinite(ahead), ahead, behind))


def complete(gray: Array, lattice: Lattice, places: Array, rounds: int = 6) -> Lattice:
    """Look for corners that are missing inside the grid or one step outside it.

    Each is predicted from its neighbours and taken where a saddle lies near the prediction and the four
    squares around it alternate as they should.

    Parameters
    ----------
    gray : (height, width) float32 array
    lattice : Lattice
    places : (M, 2) array
        Saddles of the picture, px.
    """
    if not len(places):
        return lattice
    tree = cKDTree(places)
    uv = np.pad(lattice.uv, ((1, 1), (1, 1), (0, 0)), constant_values=np.nan)
    for _ in range(rounds):
        guess = predicted(uv)
        steps = _neighbour_steps(uv)
        row, col = np.nonzero(
            np.isnan(uv[..., 0]) & np.isfinite(guess[..., 0]) & np.isfinite(steps).all((-1, -2))
        )
        if not len(row):
            break
        distance, nearest = map(np.asarray, tree.query(guess[row, col]))
        side = np.linalg.norm(steps[row, col], axis=-1).min(-1)
        sign = colour_sign(gray, Lattice(uv))
        contrast = _corner_contrast(gray, places[nearest], steps[row, col])
        contrast *= np.where((row + col) % 2 == 0, 1, -1) * np.sign(sign)
        good = (distance < REACH * side) & (contrast > 0.4 * abs(sign))
        if not good.any():
            break
        uv[row[good], col[good]] = places[nearest[good]]
        present = np.isfinite(uv[..., 0])
        edges = [present[0].any(), present[-1].any(), present[:, 0].any(), present[:, -1].any()]
        top, bottom, left, right = (int(e) for e in edges)
        uv = np.pad(uv, ((top, bottom), (left, right), (0, 0)), constant_values=np.nan)
    return _bounded(uv)


def _bounded(uv: Array) -> Lattice:
    present = np.isfinite(uv[..., 0])
    rows, cols = np.flatnonzero(present.any(1)), np.flatnonzero(present.any(0))
    return Lattice(uv[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1])


def _shifted(uv: Array, down: int, right: int) -> Array:
    """Entry (r, c) of the result is entry (r + down, c + right); NaN outside."""
    out = np.full_like(uv, np.nan)
    height, width = uv.shape[:2]
    r0, r1 = max(0, -down), min(height, height - down)
    c0, c1 = max(0, -right), min(width, width - right)
    if r0 < r1 and c0 < c1:
        out[r0:r1, c0:c1] = uv[r0 + down : r1 + down, c0 + right : c1 + right]
    return out


def predicted(uv: Array) -> Array:
    """Where a corner should be: the mean of the lines and parallelograms of neighbours that lead there."""
    guesses = []
    for down, right in ((0, 1), (1, 0)):
        one, other = _shifted(uv, down, right), _shifted(uv, -down, -right)
        guesses.append(0.5 * (one + other))
    if all(np.isnan(g).all() for g in guesses):
        guesses = []
    for down, right in ((0, 1), (1, 0), (0, -1), (-1, 0)):
        a, b, c = (_shifted(uv, n * down, n * right) for n in (1, 2, 3))
        bent = 3 * a - 3 * b + c
        guesses.append(np.where(np.isfinite(bent), 0.5 * (bent + 2 * a - b), 2 * a - b))
    for down, right in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        guesses.append(_shifted(uv, down, 0) + _shifted(uv, 0, right) - _shifted(uv, down, right))
    return _mean(np.stack(guesses))


def _neighbour_steps(uv: Array) -> Array:
    """Steps along columns and rows at every place, from the place itself or the corners around it."""
    own = np.stack([_step(uv, 1), _step(uv, 0)], 2)
    around = [_shifted(own, d, r) for d, r in ((0, 1), (1, 0), (0, -1), (-1, 0))]
    return np.where(np.isfinite(own), own, _mean(np.stack(around)))


def _mean(stack: Array) -> Array:
    """Mean over the first axis of what is not NaN."""
    known = np.isfinite(stack)
    number = known.sum(0)
    total = np.where(known, stack, 0).sum(0)
    return np.where(number > 0, total / np.maximum(number, 1), np.nan)


def _sample(gray: Array, at: Array) -> Array:
    flat = at.reshape(-1, 1, 2).astype(np.float32)
    value = cv2.remap(gray, flat, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return value.reshape(at.shape[:-1]).astype(float)


def _corner_contrast(gray: Array, uv: Array, steps: Array) -> Array:
    """How much brighter the squares down-right and up-left are than the two others; 0 where unclear."""
    a, b = 0.3 * steps[..., 0, :], 0.3 * steps[..., 1, :]
    plus = _sample(gray, np.stack([uv + a + b, uv - a - b]))
    minus = _sample(gray, np.stack([uv + a - b, uv - a + b]))
    up, down = plus.min(0) - minus.max(0), plus.max(0) - minus.min(0)
    return np.where(up > 0, up, np.where(down < 0, down, 0.0))


def _square_values(gray: Array, uv: Array) -> Array:
    """Grey values (rows - 1, columns - 1) at the centres of the squares; NaN where a corner is missing."""
    centre = 0.25 * (uv[:-1, :-1] + uv[1:, :-1] + uv[:-1, 1:] + uv[1:, 1:])
    known = np.isfinite(centre[..., 0])
    value = np.full(known.shape, np.nan)
    if known.any():
        value[known] = _sample(gray, centre[known])
    return value


def colour_sign(gray: Array, lattice: Lattice) -> float:
    """Median brightness of the squares of the parity of the first, less that of the others, grey levels.

    Negative where the square between corners (0, 0) and (1, 1) is black; 0 where there is nothing to compare.
    """
    value = _square_values(gray, lattice.uv)
    even = np.indices(value.shape).sum(0) % 2 == 0
    known = np.isfinite(value)
    if not (known & even).any() or not (known & ~even).any():
        return 0.0
    return float(np.median(value[known & even]) - np.median(value[known & ~even]))


def alternation(gray: Array, lattice: Lattice) -> float:
    """Share of neighbouring squares that are as unlike as the colours of a checkerboard should be."""
    value = _square_values(gray, lattice.uv)
    sign = np.where(np.indices(value.shape).sum(0) % 2 == 0, 1, -1) * np.sign(colour_sign(gray, lattice))
    steps = [(value[:, :-1] - value[:, 1:]) * sign[:, :-1], (value[:-1] - value[1:]) * sign[:-1]]
    known = np.concatenate([s[np.isfinite(s)] for s in steps])
    return float((known > 0.25 * np.median(known)).mean()) if len(known) and np.median(known) > 0 else 0.0


def trimmed(lattice: Lattice) -> Lattice:
    """Without the rows and columns at the edges that hold too few corners, the emptiest first."""
    uv = lattice.uv
    while min(uv.shape[:2]) > 1:
        present = np.isfinite(uv[..., 0])
        shares = [present[0].mean(), present[-1].mean(), present[:, 0].mean(), present[:, -1].mean()]
        worst = int(np.argmin(shares))
        if shares[worst] >= SPARSE:
            break
        uv = (uv[1:], uv[:-1], uv[:, 1:], uv[:, :-1])[worst]
    return Lattice(uv)


def oriented(gray: Array, lattice: Lattice, columns: int, rows: int) -> Lattice | None:
    """Turn a grid so that it has the wanted columns and rows and its first outer square is black.

    Where that leaves more than one way, the columns run as nearly to the right of the picture as they can:
    a board whose sides are both odd or both even looks the same after half a turn. None where the size does
    not match.
    """
    ways = [lattice.turned(k) for k in range(4)]
    ways = [w for w in ways if w.size == (columns, rows)]
    if not ways:
        return None
    black_first = [w for w in ways if colour_sign(gray, w) < 0]
    return max(black_first or ways, key=_rightward)


def _rightward(lattice: Lattice) -> float:
    step = np.nanmean(np.diff(lattice.uv, axis=1).reshape(-1, 2), axis=0)
    return float(step[0] / np.linalg.norm(step))
