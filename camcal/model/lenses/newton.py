"""The inverse of a plane distortion: two equations in two unknowns, for all points at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from camcal.model.lenses.curve import Inverse
from camcal.model.lenses.radial import TINY

Array = np.ndarray
#: (a, b) -> (x, y, dx/da, dx/db, dy/da, dy/db)
Map = Callable[[Array, Array], tuple[Array, ...]]

#: Newton ends with a step that is no longer than this, as the next would be its square, below the rounding
LAST_STEP = 1e-9
#: steps for all points at once: from the radial start three or four are enough over the contract tests' pictures
QUICK = 5
#: further steps for points that have not arrived: next to a fold Newton halves the error, and 2^-20 is 1e-6
SLOW = 20
#: in focal lengths: with a residual below this a point is found, 1e-8 px at a focal length of 1000 px; next to a fold
#: the rounding of the map allows no less
SOLVED = 1e-11
#: rad: radii beyond tan of this angle, 1000 focal lengths, are begun from there
WIDEST = np.pi / 2 - 1e-3
#: of a limit, where the slope is 0 or infinite: the table of the inverse ends so far before it
INSIDE = 1 - 1e-9


def solve(function: Map, x: Array, y: Array, a: Array, b: Array) -> tuple[Array, Array, Array]:
    """Solve function(a, b) = (x, y).

    Parameters
    ----------
    x, y, a, b : (N,) arrays; a, b the start, which is overwritten

    Returns
    -------
    a, b : (N,) arrays
    solved : (N,) bool array
    """
    for _ in range(QUICK):
        da, db = _step(function, x, y, a, b)
        a -= da
        b -= db
        np.abs(da, out=da)
        np.abs(db, out=db)
        np.maximum(da, db, out=da)
        if da.max(initial=0.0) <= LAST_STEP:
            return a, b, np.ones(a.shape, bool)
    rest = ~(da <= LAST_STEP)
    solved = ~rest
    a[rest], b[rest], solved[rest] = _slowly(function, x[rest], y[rest], a[rest], b[rest])
    return a, b, solved


def _step(function: Map, x: Array, y: Array, a: Array, b: Array) -> tuple[Array, Array]:
    """Newton's step, to be subtracted."""
    fx, fy, xa, xb, ya, yb = function(a, b)
    fx -= x
    fy -= y
    det = xa * yb
    det -= xb * ya
    da = yb * fx
    da -= xb * fy
    da /= det
    fy *= xa
    fx *= ya
    fy -= fx
    fy /= det
    return da, fy


def _slowly(function: Map, x: Array, y: Array, a: Array, b: Array) -> tuple[Array, Array, Array]:
    """Iterate while the residual of any point is halved."""
    best = np.full(a.shape, np.inf)
    for _ in range(SLOW):
        size = _residual(function, x, y, a, b)
        if not (size < 0.5 * best).any():
            break
        best = np.fmin(size, best)
        da, db = _step(function, x, y, a, b)
        a, b = a - da, b - db
    return a, b, _residual(function, x, y, a, b) < SOLVED


def _residual(function: Map, x: Array, y: Array, a: Array, b: Array) -> Array:
    fx, fy = function(a, b)[:2]
    return np.maximum(np.abs(fx - x), np.abs(fy - y))


class RadialStart:
    """The inverse (a, b) of the radial part r f(r²) alone, in t = atan r.

    Parameters
    ----------
    series : s -> (f, df/ds)
    limit : float
        Where r f(r²) folds back or has a pole; may be inf.
    """

    def __init__(self, series: Callable[[Array], tuple[Array, Array]], limit: float):
        def in_t(t: Array) -> tuple[Array, Array]:
            r = np.tan(t)
            s = r * r
            f, slope = series(s)
            return r * f, (f + 2 * s * slope) * (1 + s)

        self._inverse = Inverse(in_t, min(float(np.arctan(limit)) * INSIDE, WIDEST))

    def __call__(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Return new arrays a, b of distorted x, y."""
        distorted = x * x
        distorted += y * y
        np.sqrt(distorted, out=distorted)
        distorted += TINY
        ratio = self._inverse.start(distorted)
        np.tan(ratio, out=ratio)
        ratio /= distorted
        return x * ratio, y * ratio
