"""Monotone curves of one variable: their first fold, and their inverse for many values at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np

Array = np.ndarray
T = TypeVar("T")

#: A root counts as real where its imaginary part is below this part of its size: a double root, which is
#: where a fold appears, is only known to the root of the rounding, 1e-8.
REAL = 1e-7
#: relative error at which the inverse of a curve cannot get better, and up to which it counts as found
ROUNDING, SOLVED = 2e-16, 1e-12


def first_root(ascending: Sequence[float] | Array, top: float = np.inf) -> float:
    """The smallest positive real root of a polynomial, coefficients in ascending order; `top` without one.

    A root where the polynomial touches 0 without a change of sign counts, too. The eigenvalues of the
    companion matrix (Horn & Johnson 1985, section 3.3), without what numpy.roots does around them.
    """
    c = [float(v) for v in ascending]
    largest = max((abs(v) for v in c), default=0.0)
    while c and abs(c[-1]) <= 1e-150 * largest:  # its root lies beyond all numbers
        c.pop()
    if len(c) < 2 or not np.isfinite(largest):
        return top
    companion = np.eye(len(c) - 1, k=-1)
    companion[:, -1] = np.array(c[:-1]) / -c[-1]
    roots = np.linalg.eigvals(companion)
    found = top
    for root in roots.tolist():
        if root.real > 0 and abs(root.imag) <= REAL * abs(root):
            found = min(found, root.real)
    return found


def invert(
    function: Callable[[Array], tuple[Array, Array]], top: float, target: Array, knots: int = 129
) -> tuple[Array, Array]:
    """Solve f(t) = target for t in [0, top], where f(0) = 0 and f grows.

    Interpolation in a table of f, then Newton; where that has not converged in a few steps (next to a fold or
    a pole), Newton within a shrinking bracket.

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
    reachable = (target >= 0) & (target <= values[-1])
    fine = np.maximum(1.0, np.minimum(np.abs(target), values[-1]))
    error = np.inf
    for _ in range(5):
        f, slope = function(t)
        f -= target
        last, error = error, float(np.max(np.abs(f) / fine, where=reachable, initial=0.0))
        if error <= ROUNDING or last <= 1e-8:  # quadratic: the step after 1e-8 has ended at rounding
            break
        f /= slope
        t -= f
        np.clip(t, 0.0, top, out=t)
    if not error <= SOLVED:
        t, f = _bracketed(function, top, target, t, reachable)
    return t, reachable & (np.abs(f) <= SOLVED * fine)


def _bracketed(
    function: Callable[[Array], tuple[Array, Array]], top: float, target: Array, t: Array, reachable: Array
) -> tuple[Array, Array]:
    """Newton with bisection where it would leave its bracket: (t, f - target)."""
    t = np.where(reachable & np.isfinite(t), t, 0.5 * top)
    low, high = np.zeros_like(t), np.full_like(t, top)
    for _ in range(60):
        f, slope = function(t)
        f = f - target
        low, high = np.where(f < 0, t, low), np.where(f > 0, t, high)
        step = t - f / slope
        step = np.where((step > low) & (step < high), step, 0.5 * (low + high))
        if not (np.abs(step - t)[reachable] > 1e-16 * top).any():
            break
        t = step
    return t, function(t)[0] - target


def memo(owner: Any, k: Array, compute: Callable[[Array], T], what: str = "limit") -> T:
    """`compute(k)`, remembered on `owner` for the last k: limits are asked for once per block of points."""
    key = k.tobytes()
    last = owner.__dict__.get(f"_memo_{what}")
    if last is None or last[0] != key:
        last = (key, compute(k))
        owner.__dict__[f"_memo_{what}"] = last
    return last[1]
