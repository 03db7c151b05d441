"""Monotone curves of one variable: their first fold, and their inverse for many values at once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

Array = np.ndarray

#: A root counts as real where its imaginary part is below this part of its size: a double root, which is
#: where a fold appears, is only known to the root of the rounding, 1e-8.
REAL = 1e-7


def first_root(ascending: Array, top: float = np.inf) -> float:
    """The smallest positive real root of a polynomial, coefficients in ascending order; `top` without one.

    A root where the polynomial touches 0 without a change of sign counts, too.
    """
    c = np.trim_zeros(np.asarray(ascending, float), "b")
    if len(c) < 2 or not np.isfinite(c).all():
        return top
    roots = np.roots(c[::-1])
    real = roots.real[(abs(roots.imag) <= REAL * abs(roots)) & (roots.real > 0)]
    return min(top, float(real.min())) if len(real) else top


def invert(
    function: Callable[[Array], tuple[Array, Array]],
    top: float,
    target: Array,
    knots: int = 129,
    iterations: int = 12,
) -> tuple[Array, Array]:
    """Solve f(t) = target for t in [0, top], where f(0) = 0 and f grows.

    Interpolation in a table of f, then Newton; a step that would leave the interval stops at its end.

    Parameters
    ----------
    function : t -> (f, df/dt)
    top : float
    target : array of any shape

    Returns
    -------
    t : array
    solved : bool array; False beyond f(top)
    """
    grid = np.linspace(0.0, top, knots)
    values = np.maximum.accumulate(function(grid)[0])
    t = np.interp(target, values, grid)
    size = float(values[-1])
    last = np.inf
    for _ in range(iterations):
        f, slope = function(t)
        f -= target
        worst = float(np.nanmax(np.where(target <= size, np.abs(f), 0.0), initial=0.0))
        if not worst > 1e-15 * size or not worst < 0.5 * last:
            break
        last = worst
        f /= slope
        t -= f
        np.clip(t, 0.0, top, out=t)
    return t, (target <= size) & (np.abs(function(t)[0] - target) <= 1e-11 * max(size, 1.0))


def memo(owner: Any, k: Array, compute: Callable[[Array], float]) -> float:
    """`compute(k)`, remembered on `owner` for the last k: a limit is asked for once per block of points."""
    key = k.tobytes()
    last = owner.__dict__.get("_memo")
    if last is None or last[0] != key:
        last = (key, compute(k))
        owner.__dict__["_memo"] = last
    return last[1]
