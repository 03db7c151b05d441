"""Distortion of the plane: radial, decentering and thin prism terms of any order.

A. E. Conrady (1919); D. C. Brown, Decentering distortion of lenses (1966) and Close-range camera calibration
(1971), eq. 5; J. Weng, P. Cohen, M. Herniou, Camera calibration with distortion models and accuracy
evaluation, PAMI 14 (1992), eq. 16. With s = a² + b²:

    f  = 1 + k1 s + k2 s² + ... + kn sⁿ
    h  = 1 + p3 s + p4 s² + ...
    xd = a f + (2 p1 a b + p2 (s + 2 a²)) h + s1 s                                                       (1)
    yd = b f + (p1 (s + 2 b²) + 2 p2 a b) h + s2 s

p1 and p2 stand as in OpenCV; Brown's P1, P2 are the other way round.
"""

from __future__ import annotations

import numpy as np

from camcal.model.lenses import newton
from camcal.model.lenses.curve import first_root, memo

Array = np.ndarray


class PlaneDistortion:
    """Equation (1) with `radial` terms k, `decentering` factors (0 = none, 1 = p1 p2, 2 = and p3, ...)."""

    def __init__(self, radial: int, decentering: int, prism: bool):
        self.radial, self.decentering, self.prism = radial, decentering, prism
        count = decentering + 1 if decentering else 0
        self.names = (
            *(f"k{i + 1}" for i in range(radial)),
            *(f"p{i + 1}" for i in range(count)),
            *(("s1", "s2") if prism else ()),
        )

    def _split(self, c: Array) -> tuple[list[float], float, float, list[float], float, float]:
        """k, p1, p2, the higher factors p3, ..., s1, s2."""
        values = c.tolist()
        k, rest = values[: self.radial], values[self.radial :]
        s1, s2 = rest[-2:] if self.prism else (0.0, 0.0)
        p1, p2 = rest[:2] if self.decentering else (0.0, 0.0)
        return k, p1, p2, rest[2 : self.decentering + 1] if self.decentering else [], s1, s2

    def apply(self, c: Array, a: Array, b: Array) -> tuple[Array, Array]:
        """(xd, yd) of (1)."""
        k, p1, p2, higher, s1, s2 = self._split(c)
        s = a * a + b * b
        f, h = _series(k, s)[0], _series(higher, s)[0]
        common = f + (2 * h) * (p1 * b + p2 * a)
        hs = h * s
        return a * common + p2 * hs + s1 * s, b * common + p1 * hs + s2 * s

    def derivatives(self, c: Array, a: Array, b: Array) -> tuple[Array, ...]:
        """(xd, yd) and d(xd)/da, d(xd)/db, d(yd)/da, d(yd)/db."""
        k, p1, p2, higher, s1, s2 = self._split(c)
        aa, bb, ab = a * a, b * b, a * b
        s = aa + bb
        f, slope = _series(k, s)
        slope *= 2
        x, y, cross = a * f, b * f, ab * slope
        aa *= slope
        aa += f
        bb *= slope
        bb += f
        slopes = [aa, cross, cross, bb]
        if self.decentering:
            self._decentre(p1, p2, higher, a, b, s, ab, (x, y), slopes)
        if self.prism:
            x += s1 * s
            y += s2 * s
            slopes = [d + (2 * w) * c for d, w, c in zip(slopes, (s1, s1, s2, s2), (a, b, a, b), strict=True)]
        return x, y, *slopes

    def _decentre(
        self, p1: float, p2: float, higher: list[float], a: Array, b: Array, s: Array, ab: Array,
        xy: tuple[Array, Array], slopes: list[Array],
    ) -> None:  # fmt: skip
        """Add the decentering terms to (xd, yd) in place and to the slopes."""
        p1a, p1b, p2a, p2b = p1 * a, p1 * b, p2 * a, p2 * b
        common = p1b + p2a
        common *= 2
        dx, dy = a * common + p2 * s, b * common + p1 * s
        xa, mixed, yb = 2 * p1b + 6 * p2a, 2 * (p1a + p2b), 6 * p1b + 2 * p2a
        if not higher:
            for total, part in ((xy[0], dx), (xy[1], dy), (slopes[0], xa), (slopes[3], yb)):
                total += part
            slopes[1] += mixed  # the same array as slopes[2]
            return
        h, h_slope = _series(higher, s)
        h_slope *= 2
        xy[0][...] += h * dx
        xy[1][...] += h * dy
        mixed *= h
        dx *= h_slope
        dy *= h_slope
        slopes[:] = [
            slopes[0] + h * xa + a * dx,
            slopes[1] + mixed + b * dx,
            slopes[2] + mixed + a * dy,
            slopes[3] + h * yb + b * dy,
        ]

    def coefficient_rows(self, c: Array, a: Array, b: Array, rows: Array) -> None:
        """Write d(xd, yd)/d coefficients into rows (V, Q, 2, N)."""
        _, p1, p2, higher, _, _ = self._split(c)
        s = a * a + b * b
        power = s
        for i in range(self.radial):
            np.multiply(a, power, out=rows[:, i, 0])
            np.multiply(b, power, out=rows[:, i, 1])
            power = power * s
        at = self.radial
        if self.decentering:
            h = _series(higher, s)[0]
            ab = 2 * a * b
            rows[:, at, 0], rows[:, at, 1] = ab * h, (s + 2 * b * b) * h
            rows[:, at + 1, 0], rows[:, at + 1, 1] = (s + 2 * a * a) * h, ab * h
            dx, dy = p1 * ab + p2 * (s + 2 * a * a), p1 * (s + 2 * b * b) + p2 * ab
            for i in range(len(higher)):
                dx, dy = dx * s, dy * s
                rows[:, at + 2 + i, 0], rows[:, at + 2 + i, 1] = dx, dy
            at += 2 + len(higher)
        if self.prism:
            rows[:, at : at + 2] = 0.0
            rows[:, at, 0] = rows[:, at + 1, 1] = s

    def fold(self, c: Array) -> float:
        """Radius at which a f(a²) folds back: root of 1 + 3 k1 s + 5 k2 s² + ...; inf without one."""
        return memo(self, c, self._fold, "fold")

    def _fold(self, c: Array) -> float:
        k = c[: self.radial]
        return float(np.sqrt(first_root(np.array([1.0, *((2 * i + 3) * v for i, v in enumerate(k))]))))

    def invert(self, c: Array, xd: Array, yd: Array) -> tuple[Array, Array, Array]:
        """(a, b) of (xd, yd) within the fold, and which were found: Newton from the radial part's inverse."""
        if not len(self.names):
            return xd, yd, np.isfinite(xd) & np.isfinite(yd)
        a, b = memo(self, c, self._start, "start")(xd, yd)
        a, b, solved = newton.solve(lambda a, b: self.derivatives(c, a, b), xd, yd, a, b)
        return a, b, solved & (a * a + b * b < self.fold(c) ** 2)

    def _start(self, c: Array) -> newton.RadialStart:
        k = c[: self.radial].tolist()
        return newton.RadialStart(lambda s: _series(k, s), self.fold(c))


def _series(c: list[float], s: Array) -> tuple[Array, Array]:
    """1 + c1 s + c2 s² + ... and its derivative."""
    value, slope = np.zeros_like(s), np.zeros_like(s)
    for v in reversed(c):
        slope *= s
        slope += value
        value *= s
        value += v
    # value = c1 + c2 s + ..., slope its derivative
    slope *= s
    slope += value
    value *= s
    value += 1.0
    return value, slope
