"""Monotone curves of one variable: their first fold, and their inverse for many values at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache, wraps
from math import comb, floor, isfinite, ldexp, log2
from operator import mul
from typing import Any, TypeVar

import numpy as np

Array = np.ndarray
T = TypeVar("T")

#: A root counts as real where its imaginary part is below this part of its size: a double root, where a fold
#: appears, is known to the square root of the rounding only, 1e-8, and ten times that is allowed.
REAL = 1e-7
#: What a term may have at the first root to be left out: a rounding.
NEGLIGIBLE = np.finfo(float).eps
#: 2 to it is 1e289, and what is divided by FARTHEST still a number
LARGEST_POWER = 960
#: reciprocal of a root, in units of the first one, from which on the rounding makes it up: no radius² is 1e15
FARTHEST = 1e-15
#: what a root may leave of a polynomial, as a part of the sum of its terms' sizes: the rounding of a root 1e7 times as
#: far as the first, which is known to 1e-9 of itself only; what the rounding makes up leaves a part of the order of 1
LEFT = 1e-7
#: error of f, relative above 1, up to which its inverse counts as found: some thousand roundings, 1e-9 px in a picture
#: with a focal length of 1000 px
SOLVED = 1e-12
#: cells of the table of an inverse: cubics over 1/256 err by about (1/256)⁴ = 2e-10, so that one step of Newton is
#: left; the table takes 8 kB
CELLS = 256
#: what stands for infinity in the table: the tangent of 90 degrees less 1e-12 rad
HUGE = 1e12
#: Newton ends with a step that is no longer than this, as the next would be its square, below the rounding
LAST_STEP = 1e-9
#: steps of Newton for all values at once; where four, which square 1e-2 to 1e-32, have not been enough, the curve is
#: next to a fold, and the bracketed steps are the faster ones
QUICK = 4
#: bracketed steps: bisection alone gets from 1 to the rounding in 53
BRACKETED = 60
#: part of the range by which a bracketed step still counts as a step: half the rounding of a number of its size
STILL = 1e-16
#: slope of a cubic at its ends, in chords, up to which it grows (Fritsch & Carlson 1980)
STEEPEST = 3
#: results that `cached` keeps of each method: a few cameras at once, of a dozen kB each
KEPT = 64


def first_root(ascending: Sequence[float] | Array, top: float = np.inf) -> float:
    """The smallest positive real root of a polynomial, coefficients in ascending order; `top` if there is none.

    A root where the polynomial touches 0 without a change of sign counts, too. 0 where a coefficient is not finite.
    By the eigenvalues of the companion matrix (Horn & Johnson 1985, section 3.3) of the reversed polynomial, in the
    reciprocal of a scaled variable: the first root is the largest of its eigenvalues, which has all digits however far
    the other roots are.
    """
    c = [float(v) for v in ascending]
    if not all(map(isfinite, c)):
        return 0.0
    while c and c[0] == 0:
        del c[0]
    if not c:
        return top
    scaled, power = _scaled(c)
    if len(scaled) < 2:
        return top
    companion = np.eye(len(scaled) - 1, k=1)
    companion[:, 0] = np.negative(scaled[1:])
    found = top
    for inverse in np.linalg.eigvals(companion).tolist():
        if inverse.real > FARTHEST and abs(inverse.imag) <= REAL * abs(inverse):
            terms = [v / inverse.real**i for i, v in enumerate(scaled)]
            if abs(sum(terms)) <= LEFT * sum(map(abs, terms)):
                found = min(found, ldexp(1 / inverse.real, power))
    return found


def _scaled(c: list[float]) -> tuple[list[float], int]:
    """The coefficients over the first one, of the variable in units of 2^power: none is above 1, and the largest but
    the first about 1, so that the root next to 0 lies between 1/2 and twice their number (Cauchy's bounds).
    """
    c = [v / c[0] for v in c]
    power = min((floor(-log2(abs(v)) / i) for i, v in enumerate(c) if i and v), default=0)
    power = min(power, LARGEST_POWER)
    scaled = [ldexp(v, i * power) for i, v in enumerate(c)]
    while scaled and abs(scaled[-1]) * (2 * len(c)) ** (len(scaled) - 1) <= NEGLIGIBLE:
        scaled.pop()
    return scaled, power


def bernstein(ascending: Sequence[Any], top: Any) -> list[Any]:
    """The Bernstein coefficients of a polynomial over [0, top]; it lies between the smallest and the largest of them.

    Of numbers, or of arrays element by element. In Python, because the refinement asks for those of three or seven
    coefficients at every step.
    """
    scaled, power = [], 1.0
    for a in ascending:
        scaled.append(a * power)
        power = power * top
    return [sum(map(mul, row, scaled)) for row in _to_bernstein(len(scaled))]


@lru_cache(maxsize=32)
def _to_bernstein(count: int) -> list[list[float]]:
    """b_j = Σ C(j, i) / C(n, i) a_i (G. Farin, Curves and surfaces for CAGD, 2002, section 6.1), n = count - 1."""
    return [[comb(j, i) / comb(count - 1, i) for i in range(j + 1)] for j in range(count)]


class Inverse:
    """The inverse of a curve that grows from f(0) = 0 over [0, top], for many values at once.

    A table of cubics over even steps of f / (1 + f) gives t to 1e-9 and better, Newton the rest, in one step
    where the curve is smooth. Where a few steps have not been enough (next to a fold or a pole), Newton goes
    on within a shrinking bracket.

    Parameters
    ----------
    function : t -> (f, df/dt), element by element
    top : float
    """

    def __init__(self, function: Callable[[Array], tuple[Array, Array]], top: float):
        self.function, self.top = function, top
        with np.errstate(all="ignore"):  # a slope of 0 at the fold itself
            self._fill()

    def _fill(self) -> None:
        """Fill the table."""
        function, top = self.function, self.top
        grid = np.linspace(0.0, top, CELLS + 1)
        values = np.maximum.accumulate(np.nan_to_num(function(grid)[0], nan=0.0, posinf=HUGE))
        self.end = float(values[-1])
        share = np.linspace(0.0, self.end / (1 + self.end), CELLS + 1)
        self._scale = CELLS / share[-1] if share[-1] > 0 else 0.0
        even = share / (1 - share)
        t, _ = self._newton(np.interp(even, values, grid), even)
        slope = (1 + even) ** 2 / function(t)[1]
        self._table = _cubics(t, slope / self._scale if self._scale else 0.0 * slope)

    def start(self, target: Array) -> Array:
        """Approximate t from the table alone, within [0, top]."""
        place = target / (1 + target)
        place *= self._scale
        cell = place.astype(np.intp)
        place -= cell
        t = self._table[3].take(cell, mode="clip")
        for row in self._table[2::-1]:
            t *= place
            t += row.take(cell, mode="clip")
        return np.clip(t, 0.0, self.top, out=t)

    def __call__(self, target: Array) -> tuple[Array, Array]:
        """Solve f(t) = target: t, and which targets have a solution; False beyond f(top)."""
        reachable = (target >= 0) & (target <= self.end)
        if not reachable.all():
            target = np.where(reachable, target, 0.0)
        with np.errstate(all="ignore"):
            t, solved = self._newton(self.start(target), target)
        return t, reachable & solved

    def _newton(self, t: Array, target: Array) -> tuple[Array, Array]:
        for _ in range(QUICK):
            f, slope = self.function(t)
            f -= target
            f /= slope
            t -= f
            np.clip(t, 0.0, self.top, out=t)
            np.abs(f, out=f)
            if f.max(initial=0.0) <= LAST_STEP:
                return t, np.ones(t.shape, bool)
        rest = ~(f <= LAST_STEP)
        solved = ~rest
        t[rest], solved[rest] = self._bracketed(target[rest])
        return t, solved

    def _bracketed(self, target: Array) -> tuple[Array, Array]:
        """Newton's method, with bisection where a step would leave the bracket."""
        low, high = np.zeros_like(target), np.full_like(target, self.top)
        t = 0.5 * high
        for _ in range(BRACKETED):
            f, slope = self.function(t)
            f = f - target
            low, high = np.where(f < 0, t, low), np.where(f > 0, t, high)
            step = t - f / slope
            step = np.where((step > low) & (step < high), step, 0.5 * (low + high))
            if not (np.abs(step - t) > STILL * self.top).any():
                break
            t = step
        return t, np.abs(self.function(t)[0] - target) <= SOLVED * np.maximum(1.0, target)


def _cubics(t: Array, slope: Array) -> Array:
    """Coefficients (4, N - 1), ascending, of the cubics through values and slopes over cells of length 1.

    Slopes are limited to three times the chord, so that the cubics grow (F. Fritsch & R. Carlson, SIAM J. Numer.
    Anal. 17, 1980).
    """
    chord = np.diff(t)
    left, right = (np.clip(np.nan_to_num(s), 0.0, STEEPEST * chord) for s in (slope[:-1], slope[1:]))
    return np.stack([t[:-1], left, 3 * chord - 2 * left - right, left + right - 2 * chord])


def cached(method: Callable[[Any, Array], T]) -> Callable[[Any, Array], T]:
    """Cache the results of `method(owner, k)` for the last coefficients: limits and tables, requested once per block.

    They are kept here, by the owner's value and the coefficients' bits: equal owners share them, and the owner stays
    as it is. The result must not be changed by those who get it.
    """

    @lru_cache(maxsize=KEPT)
    def compute(owner: Any, key: bytes) -> T:
        return method(owner, np.frombuffer(key))

    @wraps(method)
    def call(owner: Any, k: Array) -> T:
        return compute(owner, k.tobytes())

    return call
