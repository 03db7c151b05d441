"""The sub-pixel corners of a whole grid: first each for itself, then with what they tell of each other."""

from __future__ import annotations

import numpy as np

from camcal.detect import saddle
from camcal.detect.lattice import Lattice, predicted
from camcal.detect.local_map import board_from_corners

Array = np.ndarray

LEAST_CORNERS = 4  #: fewer tell nothing of each other
MORE_BLURRED = 1.5  #: times the blur that a first fit starts from
LEAST_GOOD = 0.5  #: share of good first fits from which on the others are tried again
FINAL = ("at the border of the picture", "too little contrast")  #: reasons for which there is no second trial


def sharp_corners(gray: Array, lattice: Lattice, blur: float) -> tuple[Array, saddle.Corners, dict[int, str]]:
    """Fit the corners of a grid.

    Parameters
    ----------
    gray : (height, width) array
    lattice : Lattice
        px of that picture.
    blur : float
        px; to start from, at least half the error of the lattice.

    Returns
    -------
    ids : (N,) int array
    corners : Corners
        The good ones, in the order of `ids`.
    reasons : dict
        Why the others were rejected, by id.
    """
    ids = np.flatnonzero(lattice.usable.ravel())
    uv, sides = lattice.uv.reshape(-1, 2), lattice.steps().reshape(-1, 2, 2)
    first = _first(gray, uv[ids], sides[ids], blur)
    again = _to_be_tried(first)
    rejected = _reasons(ids, first)
    if again.sum() < LEAST_CORNERS:
        return ids[first.good], first.take(first.good), rejected
    ids, known = ids[again], first.take(again)
    shape = lattice.uv.shape
    good = np.full_like(uv, np.nan)
    good[ids[known.good]] = known.uv[known.good]
    if not known.good.all():
        row, col = np.divmod(ids, shape[1])
        guess = predicted(good.reshape(shape), row, col)
        guess = np.where(np.isfinite(guess), guess, uv[ids])
        known = saddle.with_guesses(known, guess, sides[ids], np.where((row + col) % 2 == 0, 1, -1))
        good[ids] = known.uv
    half = saddle.wider_halves(shape[1], shape[0])[ids]
    second = saddle.sharpen(gray, known, sides[ids], board_from_corners(good.reshape(shape)), half)
    rejected = {i: r for i, r in rejected.items() if i not in set(ids.tolist())} | _reasons(ids, second)
    return ids[second.good], second.take(second.good), rejected


def _first(gray: Array, uv: Array, sides: Array, blur: float) -> saddle.Corners:
    """Fit each corner for itself; again where the picture proves more blurred than the windows allow for."""
    half = saddle.usual_half(sides)
    corners = saddle.refine(gray, uv, sides, half, blur)
    seen = float(np.median(corners.blur)) if len(uv) else 0.0
    if seen > MORE_BLURRED * blur:
        corners = saddle.refine(gray, uv, sides, saddle.WIDER_HALF, 1.2 * seen)
    return corners


def _to_be_tried(first: saddle.Corners) -> Array:
    """The good corners, and with them those whose fit may have gone astray."""
    good = first.good
    if good.mean() < LEAST_GOOD if len(good) else True:
        return good
    return good | np.array([r not in FINAL for r in first.reasons], bool)


def _reasons(ids: Array, corners: saddle.Corners) -> dict[int, str]:
    return {int(i): r for i, r in zip(ids, corners.reasons, strict=True) if r}


def fit_reduced(picture: Array, lattice: Lattice) -> Lattice:
    """Fit the corners of a grid in the reduced picture it was found on, each for itself."""
    usable = lattice.usable
    sides = lattice.steps()[usable]
    corners = saddle.refine(picture, lattice.uv[usable], sides, saddle.usual_half(sides))
    uv = lattice.uv.copy()
    uv[usable] = np.where(corners.good[:, None], corners.uv, uv[usable])
    return Lattice(uv)
