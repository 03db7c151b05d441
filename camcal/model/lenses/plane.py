"""Distortion of the plane z = 1: radial, decentering and thin prism terms.

A. E. Conrady (1919); D. C. Brown, Decentering distortion of lenses (1966) and Close-range camera calibration
(1971), eq. 5; J. Weng, P. Cohen, M. Herniou, Camera calibration with distortion models and accuracy evaluation,
PAMI 14 (1992), eq. 16; OpenCV's documentation of camera calibration. With s = a² + b²:

    f  = (1 + n1 s + n2 s² + ...) / (1 + d1 s + d2 s² + d3 s³)                                           (1)
    h  = 1 + p3 s + p4 s² + ...
    xd = a f + (2 p1 a b + p2 (s + 2 a²)) h + x1 s + x2 s²                                               (2)
    yd = b f + (p1 (s + 2 b²) + 2 p2 a b) h + y1 s + y2 s²

p1 and p2 stand as in OpenCV; Brown's P1, P2 are the other way round. Models choose among these terms, in an order of
their own.
"""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from camcal.model.lenses import newton
from camcal.model.lenses.curve import bernstein, cached, first_root
from camcal.model.lenses.parameters import each
from camcal.records import dataclass

Array = np.ndarray


class _Coefficients(NamedTuple):
    """The coefficients by kind: numerator, denominator, p1, p2, p3 and higher, prism."""

    n: list[float]
    d: list[float]
    p1: float
    p2: float
    higher: list[float]
    x: list[float]
    y: list[float]


@dataclass(frozen=True)
class PlaneDistortion:
    """Equations (1) and (2) with the given terms.

    Attributes
    ----------
    terms : tuple of str
        In the order of the coefficients: `n1`..., `d1`..., `p1`, `p2`, ..., `x1`, `x2`, `y1`, `y2`. Without a gap in
        each kind; p1 and p2 together.
    """

    terms: tuple[str, ...]

    @cached_property
    def _at(self) -> dict[str, list[int]]:
        """The indices of the coefficients of each kind."""
        found = {kind: [i for i, t in enumerate(self.terms) if t[0] == kind] for kind in "ndpxy"}
        return {kind: sorted(at, key=lambda i: int(self.terms[i][1:])) for kind, at in found.items()}

    def _split(self, c: Array) -> _Coefficients:
        values = each(c)
        n, d, p, x, y = [[values[i] for i in at] for at in self._at.values()]
        p1, p2 = p[:2] or (0.0, 0.0)
        return _Coefficients(n, d, p1, p2, p[2:], x, y)

    def apply(self, c: Array, a: Array, b: Array) -> tuple[Array, Array]:
        """The distorted point (xd, yd) by (2)."""
        k, s = self._split(c), a * a + b * b
        common = _series(k.n, s)
        if k.d:
            common /= _series(k.d, s)
        h = _series(k.higher, s) if k.higher else 1.0
        if self._at["p"]:
            common += h * ((2 * k.p1) * b + (2 * k.p2) * a)
        xd, yd = a * common, b * common
        if self._at["p"]:
            hs = h * s
            xd += k.p2 * hs
            yd += k.p1 * hs
        for out, prism in ((xd, k.x), (yd, k.y)):
            if prism:
                out += _polynomial(prism, s)
        return xd, yd

    def linearise(
        self, c: Array, a: Array, b: Array, rows: Array, fx: float, fy: float
    ) -> tuple[tuple[Array, ...], bool | Array]:
        """The distorted point by (2), with derivatives.

        Parameters
        ----------
        a, b : (V, N) arrays
        rows : (V, Q, 2, N) array, filled with d(fx xd, fy yd) / dc

        Returns
        -------
        (xd, yd, dxd/da, dxd/db, dyd/da, dyd/db) : (V, N) arrays, without the focal lengths
        grows : bool
            Whether all points lie before the fold of the radial part; of coefficients (Q, V, 1), by view (V, 1).
        """
        k, s = self._split(c), a * a + b * b
        f, slope, inverse = _radial(k, s)
        self._rows(k, (a, b), s, (f, inverse), rows, (fx, fy))
        grows = (
            self._grows(c, k, float(s.max(initial=0.0)))
            if c.ndim == 1
            else self._grow(c, k, s.max(1, keepdims=True))
        )
        return _partials(k, a, b, s, f, slope), grows

    def derivatives(self, c: Array, a: Array, b: Array) -> tuple[Array, ...]:
        """xd, yd, dxd/da, dxd/db, dyd/da, dyd/db."""
        k, s = self._split(c), a * a + b * b
        return _partials(k, a, b, s, *_radial(k, s)[:2])

    def _rows(
        self,
        k: _Coefficients,
        ab: tuple[Array, Array],
        s: Array,
        radial: tuple[Array, Array | None],
        rows: Array,
        focal: tuple[float, float],
    ) -> None:
        """d(fx xd, fy yd) / dc."""
        (a, b), (f, inverse), (fx, fy) = ab, radial, focal
        at, s_ = self._at, s[:, None]
        if first := (at["n"] or at["d"])[:1]:
            np.multiply(a, fx * s, out=rows[:, first[0], 0])
            np.multiply(b, fy * s, out=rows[:, first[0], 1])
            if inverse is not None:
                rows[:, first[0]] *= inverse[:, None]
        for before, i in pairwise(at["n"]):
            np.multiply(rows[:, before], s_, out=rows[:, i])
        if at["d"]:
            np.multiply(rows[:, first[0]], -f[:, None], out=rows[:, at["d"][0]])
        for before, i in pairwise(at["d"]):
            np.multiply(rows[:, before], s_, out=rows[:, i])
        if at["p"]:
            i, j, *more = at["p"]
            ab2 = (2.0 * a) * b
            np.multiply(ab2, fx, out=rows[:, i, 0])
            np.multiply(2.0 * (b * b) + s, fy, out=rows[:, i, 1])
            np.multiply(2.0 * (a * a) + s, fx, out=rows[:, j, 0])
            np.multiply(ab2, fy, out=rows[:, j, 1])
            if more:
                np.multiply(k.p1 * rows[:, i] + k.p2 * rows[:, j], s_, out=rows[:, more[0]])
                for before, m in pairwise(more):
                    np.multiply(rows[:, before], s_, out=rows[:, m])
                h = _series(k.higher, s)[:, None]
                rows[:, i] *= h
                rows[:, j] *= h
        for axis, kind in enumerate("xy"):
            power = focal[axis] * s
            for i in at[kind]:
                rows[:, i, axis], rows[:, i, 1 - axis] = power, 0.0
                power = power * s

    # ------------------------------------------------------------------ domain and inverse
    @cached
    def fold(self, c: Array) -> float:
        """The radius sqrt(a² + b²) at which r f(r²) folds back or has a pole; inf if there is none."""
        return float(np.sqrt(min(first_root(p) for p in _must_be_positive(self._split(c)))))

    def _grows(self, c: Array, k: _Coefficients, s: float) -> bool:
        """Return whether r f(r²) increases without a pole up to r² = s; False for NaN.

        Mostly the Bernstein coefficients over [0, s], which bound a polynomial from below, settle it without its roots.
        """
        if all(b > 0 for p in _must_be_positive(k) for b in bernstein(p, s)):
            return True
        return s < self.fold(c) ** 2

    def _grow(self, c: Array, k: _Coefficients, s: Array) -> Array:
        """`_grows` of coefficients (Q, V, 1) and squared radii (V, 1), by view."""
        grow = np.ones(s.shape, bool)
        for polynomial in _must_be_positive(k):
            for b in bernstein(polynomial, s):
                grow &= b > 0
        for v in np.flatnonzero(~grow):
            grow[v] = s[v, 0] < self.fold(c[:, v, 0]) ** 2
        return grow

    def invert(self, c: Array, xd: Array, yd: Array) -> tuple[Array, Array, Array]:
        """(a, b) of (xd, yd) within the fold, and which were found: Newton's method from the inverse of the radial
        part.
        """
        a, b = self._start(c)(xd, yd)
        a, b, solved = newton.solve(lambda a, b: self.derivatives(c, a, b), xd, yd, a, b)
        return a, b, solved & (a * a + b * b < self.fold(c) ** 2)

    @cached
    def _start(self, c: Array) -> newton.RadialStart:
        return newton.RadialStart(lambda s: _radial(self._split(c), s)[:2], self.fold(c))


def _must_be_positive(k: _Coefficients) -> list[list[float]]:
    """Polynomials in s, ascending, that are positive where r f(r²) increases: its slope times the squared
    denominator, and the denominator.
    """
    if not k.d:
        return [[1.0, *((2 * i + 3) * n for i, n in enumerate(k.n))]]
    slope = [0.0] * (len(k.n) + len(k.d) + 1)
    for i, n in enumerate([1.0, *k.n]):  # n d + 2 s (n' d - n d'), with s n' = (0, n1, 2 n2, ...)
        for j, d in enumerate([1.0, *k.d]):
            slope[i + j] += (1 + 2 * (i - j)) * n * d
    return [slope, [1.0, *k.d]]


def _radial(k: _Coefficients, s: Array) -> tuple[Array, Array, Array | None]:
    """f of (1), df/ds, and the reciprocal of the denominator where there is one."""
    f, slope = _series_and_slope(k.n, s)
    if not k.d:
        return f, slope, None
    inverse, below = _series_and_slope(k.d, s)
    np.divide(1.0, inverse, out=inverse)
    f *= inverse
    below *= f
    slope -= below
    slope *= inverse
    return f, slope, inverse


def _partials(k: _Coefficients, a: Array, b: Array, s: Array, f: Array, slope: Array) -> tuple[Array, ...]:
    p1, p2, higher = k.p1, k.p2, k.higher
    common = f + (2 * p2) * a
    common += (2 * p1) * b
    xd, yd = a * common, b * common
    xd += p2 * s
    yd += p1 * s
    slope = 2.0 * slope
    xa, mixed = slope * a, slope * b
    xa += 4 * p2
    xa *= a
    xa += common
    yb = mixed + 4 * p1
    yb *= b
    yb += common
    mixed += 2 * p1
    mixed *= a
    mixed += (2 * p2) * b
    xb = ya = mixed
    if higher:  # the terms of (2) with h - 1 in place of h
        h, h_slope = _series_and_slope(higher, s)
        h, h_slope = h - 1, 2 * h_slope
        twist = (2 * p1) * b + (2 * p2) * a
        dx, dy = a * twist + p2 * s, b * twist + p1 * s
        both = (2 * p1) * a + (2 * p2) * b
        xd, yd = xd + h * dx, yd + h * dy
        xa, xb = xa + h * (twist + (4 * p2) * a) + a * h_slope * dx, mixed + h * both + b * h_slope * dx
        ya, yb = mixed + h * both + a * h_slope * dy, yb + h * (twist + (4 * p1) * b) + b * h_slope * dy
    if k.x:
        value, by_s = _polynomial_and_slope(k.x, s)
        xd, xa, xb = xd + value, xa + 2 * a * by_s, xb + 2 * b * by_s
        value, by_s = _polynomial_and_slope(k.y, s)
        yd, ya, yb = yd + value, ya + 2 * a * by_s, yb + 2 * b * by_s
    return xd, yd, xa, xb, ya, yb


def _series(c: list[float], s: Array) -> Array:
    """1 + c1 s + c2 s² + ..."""
    if not c:
        return np.ones_like(s)
    value = _polynomial(c, s)
    value += 1.0
    return value


def _polynomial(c: list[float], s: Array) -> Array:
    """c1 s + c2 s² + ..."""
    value = c[-1] * s
    for v in reversed(c[:-1]):
        value += v
        value *= s
    return value


def _series_and_slope(c: list[float], s: Array) -> tuple[Array, Array]:
    """1 + c1 s + c2 s² + ... and its derivative."""
    if not c:
        return np.ones_like(s), np.zeros_like(s)
    value, slope = _polynomial_and_slope(c, s)
    value += 1.0
    return value, slope


def _polynomial_and_slope(c: list[float], s: Array) -> tuple[Array, Array]:
    """c1 s + c2 s² + ... and its derivative."""
    if len(c) == 1:
        return c[0] * s, np.full_like(s, c[0])
    slope = (len(c) * c[-1]) * s
    for i in range(len(c) - 1, 1, -1):
        slope += i * c[i - 1]
        slope *= s
    slope += c[0]
    return _polynomial(c, s), slope
