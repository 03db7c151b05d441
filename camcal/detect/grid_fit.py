"""Sub-pixel corners of a whole grid: fitted first independently, then again with the known shape of the grid."""

from __future__ import annotations

import numpy as np

from camcal.detect import saddle
from camcal.detect.blur_shape import shape_of
from camcal.detect.corners import Corners
from camcal.detect.edge_blur import edge_blur
from camcal.detect.lattice import Lattice, predicted
from camcal.detect.local_map import board_from_corners
from camcal.detect.targets.base import LEAST_POINTS

Array = np.ndarray

COARSE = 4.0  #: factor; corners of a picture reduced by more are first fitted there: they are too inaccurate
ERROR = 0.25  #: px of the reduced picture; error of a corner before it is fitted
LEAST_BLUR = 0.5  #: px; initial value, about that of a sharp lens and of a pixel's area
#: least share of good fits of a grid: with fewer it is not a board, or not one whose shape shows where the others are
LEAST_GOOD = 0.5
FINAL = ("at the border of the picture", "too little contrast")  #: reasons that exclude a second trial


def sharp_corners(
    gray: Array, lattice: Lattice, factor: float = 1.0, reduced: Array | None = None
) -> tuple[Array, Corners, dict[int, str]]:
    """Fit the corners of a grid.

    Parameters
    ----------
    gray : (height, width) array
    lattice : Lattice
        px of that picture.
    factor : float
        Number of px of the picture per px of the reduced picture in which the grid was found.
    reduced : (h, w) array, optional
        That picture.

    Returns
    -------
    ids : (N,) int array
    corners : Corners
        The good ones, in the order of `ids`.
    reasons : dict
        Why the others were rejected, by id.
    """
    if factor > COARSE and reduced is not None:
        lattice, factor = _fit_reduced(reduced, lattice.scaled(1 / factor)).scaled(factor), 1.0
    ids = np.flatnonzero(lattice.usable.ravel())
    uv, sides = lattice.uv.reshape(-1, 2), lattice.steps().reshape(-1, 2, 2)
    blurs = edge_blur(gray, lattice)
    shape = shape_of(blurs, sides[ids])
    blur = max(LEAST_BLUR, ERROR * factor, float(np.sqrt(np.prod(blurs))))
    first = saddle.refine(gray, uv[ids], sides[ids], blur=blur, shape=shape)
    again = _to_be_tried(first)
    rejected = _reasons(ids, first)
    if again.sum() < LEAST_POINTS:
        return ids[first.good], first.take(first.good), rejected
    ids, known = ids[again], first.take(again)
    size = lattice.uv.shape
    good = np.full_like(uv, np.nan)
    good[ids[known.good]] = known.uv[known.good]
    if not known.good.all():
        row, col = np.divmod(ids, size[1])
        guess = predicted(good.reshape(size), row, col)
        guess = np.where(np.isfinite(guess), guess, uv[ids])
        known = saddle.with_guesses(known, guess, sides[ids], np.where((row + col) % 2 == 0, 1, -1))
        good[ids] = known.uv
    half = saddle.wider_halves(size[1], size[0])[ids]
    second = saddle.sharpen(gray, known, sides[ids], board_from_corners(good.reshape(size)), half, shape)
    rejected = {i: r for i, r in rejected.items() if i not in set(ids.tolist())} | _reasons(ids, second)
    return ids[second.good], second.take(second.good), rejected


def _to_be_tried(first: Corners) -> Array:
    """The good corners, and those whose fits may have diverged."""
    good = first.good
    if good.mean() < LEAST_GOOD if len(good) else True:
        return good
    return good | np.array([r not in FINAL for r in first.reasons], bool)


def _reasons(ids: Array, corners: Corners) -> dict[int, str]:
    return {int(i): r for i, r in zip(ids, corners.reasons, strict=True) if r}


def _fit_reduced(picture: Array, lattice: Lattice) -> Lattice:
    """Fit the corners of a grid in the reduced picture in which it was found, each independently."""
    usable = lattice.usable
    corners = saddle.refine(picture, lattice.uv[usable], lattice.steps()[usable])
    uv = lattice.uv.copy()
    uv[usable] = np.where(corners.good[:, None], corners.uv, uv[usable])
    return Lattice(uv)
