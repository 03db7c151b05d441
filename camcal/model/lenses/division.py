"""The division model in both directions, and Scaramuzza's polynomial, which extends it.

A. Fitzgibbon, Simultaneous linear estimation of multiple view geometry and lens distortion, CVPR (2001),
section 2: from the distorted image radius R (in focal lengths) to the ray,

    (r, z) ~ (R, 1 + l1 R² + l2 R⁴ + ...)                                                                (1)

which holds rays of 90 degrees and more (z <= 0). The reciprocal series in the other direction,

    R = a / (1 + k1 a² + k2 a⁴ + ...),  a = r / z                                                        (2)

D. Scaramuzza, A. Martinelli, R. Siegwart, A toolbox for easily calibrating omnidirectional cameras, IROS
(2006), eq. 4, with its a0 < 0 taken into the focal length, f = |a0| (their ai = -ci / f^(i-1)):

    (r, z) ~ (R, 1 + c2 R² + c3 R³ + ... + cn Rⁿ)                                                        (3)

Their affine matrix [c d; e 1] is fx, fy and skew here; e is a turn about the axis, which the pose holds.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from camcal.model.lenses import direct
from camcal.model.lenses.base import Lens, example_list
from camcal.model.lenses.curve import cached, first_root
from camcal.model.lenses.forms import Reading, Values
from camcal.model.lenses.opencv import PlaneLens
from camcal.model.lenses.options import choice, count_option, no_options
from camcal.model.lenses.parameters import Parameter
from camcal.model.lenses.radial import ALMOST_PI, InverseRadialLens

Array = np.ndarray

#: more than published calibrations use; the columns of higher powers are nearly collinear
MOST_TERMS, MOST_DEGREE = 8, 12


class PolynomialDepth(InverseRadialLens):
    """Equations (1) and (3): z is a polynomial in the image radius, with the given exponents."""

    exponents: tuple[int, ...]

    def __init__(self, name: str, exponents: tuple[int, ...], names: list[str], skew: bool = False):
        self.exponents = exponents
        super().__init__(name, [Parameter(n, "distortion") for n in names], skew)

    def terms(self) -> dict[str, str]:
        """The powers of R in z."""
        return {f"z{e}": n for e, n in zip(self.exponents, self.names[self._own :], strict=True)}

    def readings(self, values: Values) -> Iterator[Reading]:
        """With R² alone it is also a rational function; for barrel distortion, a unified model with α = 1/2."""
        (own,) = super().readings(values)
        yield own
        first, terms = own.terms.get("z2", 0.0), {t: v for t, v in own.terms.items() if t != "z2"}
        yield Reading(terms | {"c2,0": first, "c0,2": first})
        yield Reading(terms | {"alpha": 0.5, "beta": -4 * first})

    def shapes(self, rays: Array, uv: Array, image_size: tuple[int, int] | None) -> list[Values]:
        """The linear solution; otherwise from a pinhole camera to 180 degrees and more (there R = 1 /
        sqrt(-first)).
        """
        first = self.names[self._own] if self.exponents else None
        trials = [{first: v} for v in (0.0, -0.1, -0.25, -0.45)] if first else [{}]
        found = direct.radial_depth(rays, uv, self.exponents)
        if found is None:
            return trials
        f, (cx, cy), coefficients = found
        values = dict(zip(self.names[self._own :], coefficients.tolist(), strict=True))
        return [{"fx": f, "fy": f, "cx": float(cx), "cy": float(cy), **values}, *trials]

    def _depth(self, k: Array, radius: Array) -> tuple[Array, Array]:
        """z of (1) or (3) and z - R dz/dR."""
        z, fold = np.ones_like(radius), np.ones_like(radius)
        for c, e, power in zip(k.tolist(), self.exponents, self._powers(radius), strict=True):
            z += c * power
            fold -= (c * (e - 1)) * power
        return z, fold

    def _powers(self, radius: Array) -> Iterator[Array]:
        """R to each exponent, by repeated multiplication; each array is overwritten by the next."""
        square, power, last = radius * radius, np.ones_like(radius), 0
        for e in self.exponents:
            while last < e:
                power *= radius if e - last == 1 else square
                last += 1 if e - last == 1 else 2
            yield power

    def ray_angle(self, k: Array, radius: Array) -> tuple[Array, Array]:
        """θ = atan2(R, z)."""
        z, fold = self._depth(k, radius)
        fold /= radius * radius + z * z
        return np.arctan2(radius, z), fold

    def ray_angle_rows(self, k: Array, radius: Array, d_k: Array) -> None:
        """dθ/dz = -R / (R² + z²)."""
        z, _ = self._depth(k, radius)
        slope = -radius / (radius * radius + z * z)
        for i, power in enumerate(self._powers(radius)):
            np.multiply(slope, power, out=d_k[:, i])

    @cached
    def reach(self, k: Array) -> float:
        """The first root of z - R dz/dR."""
        slope = np.zeros(max(self.exponents, default=0) + 1)
        slope[0] = 1.0
        for c, e in zip(k.tolist(), self.exponents, strict=True):
            slope[e] = -(e - 1) * c
        return first_root(slope)

    def limit(self, k: Array) -> float:
        """Without a fold z decreases forever and the angle approaches π, or z stays 1."""
        if np.isinf(self.reach(k)):
            return ALMOST_PI if np.any(k) else np.pi / 2
        return super().limit(k)

    def angle(self, k: Array, radius: Array) -> tuple[Array, Array, Array]:
        """The ray (R, z), without computing its angle."""
        z, _ = self._depth(k, radius)
        return radius, z, radius < self.reach(k)


class Division(PolynomialDepth):
    """`division:n`: equation (1)."""

    @classmethod
    def parse(cls, name: str, plain: list[str], named: dict[str, str], skew: bool) -> Lens:
        """Parse `division:n` or `division:n,direction=undistort|distort`; n = 1 by default."""
        no_options(name, plain[1:], named, ("direction",))
        terms = count_option(name, plain, 1, 0, MOST_TERMS)
        if choice(name, named, "direction", ("undistort", "distort")) == "distort":
            return ReciprocalDivision(terms, skew)
        names = [f"l{i + 1}" for i in range(terms)]
        return cls(f"division:{terms}", tuple(range(2, 2 * terms + 1, 2)), names, skew)

    def smaller(self) -> tuple[str, ...]:
        """The models with fewer terms."""
        return tuple(f"division:{n}" for n in range(len(self.exponents) - 1, 0, -1))

    def examples(self) -> list[tuple[Array, tuple[int, int]]]:
        """A mild lens and a wide one."""
        skew = [0.7] if self.has_skew else []
        n = len(self.exponents)
        return example_list(
            ([533.0, 534.0, 341.0, 234.0, *skew, *[-0.2, 0.02, -0.01, *[0.0] * MOST_TERMS][:n]], (640, 480)),
            (
                [390.0, 391.0, 640.0, 395.0, *skew, *[-0.3, -0.02, 0.002, *[0.0] * MOST_TERMS][:n]],
                (1280, 800),
            ),
        )


class Scaramuzza(PolynomialDepth):
    """`scaramuzza:n`: equation (3), degree n."""

    @classmethod
    def parse(cls, name: str, plain: list[str], named: dict[str, str], skew: bool) -> Scaramuzza:
        """Parse `scaramuzza:n`; degree 4 by default, as in the toolbox."""
        no_options(name, plain[1:], named)
        degree = count_option(name, plain, 4, 2, MOST_DEGREE)
        spec = name if not plain else f"{name}:{degree}"
        return cls(spec, tuple(range(2, degree + 1)), [f"c{i}" for i in range(2, degree + 1)], skew)

    def smaller(self) -> tuple[str, ...]:
        """Lower degrees, and the division model with the even terms."""
        degree = self.exponents[-1]
        lower = [f"scaramuzza:{n}" for n in range(degree - 1, 1, -1)]
        return (*lower, *(f"division:{n}" for n in range(degree // 2, 0, -1)))

    def examples(self) -> list[tuple[Array, tuple[int, int]]]:
        """A fisheye lens of about 190 degrees and a milder one."""
        skew = [0.7] if self.has_skew else []
        n = len(self.exponents)
        fish = [-0.26, 0.01, -0.02, 0.003, -0.001]
        return example_list(
            ([390.0, 391.0, 515.0, 385.0, *skew, *[*fish, *[0.0] * MOST_DEGREE][:n]], (1032, 778)),
            ([533.0, 534.0, 341.0, 234.0, *skew, *[-0.2, 0.03, 0.01, *[0.0] * MOST_DEGREE][:n]], (640, 480)),
        )


class ReciprocalDivision(PlaneLens):
    """`division:n,direction=distort`: equation (2), the denominator of a rational radial distortion of the plane."""

    def __init__(self, count: int, skew: bool = False):
        self.count = count
        names, terms = [f"k{i + 1}" for i in range(count)], [f"d{i + 1}" for i in range(count)]
        super().__init__(f"division:{count},direction=distort", names, terms, skew)

    @classmethod
    def parse(cls, name: str, plain: list[str], named: dict[str, str], skew: bool) -> Lens:
        """See `Division.parse`."""
        return Division.parse(name, plain, {"direction": "distort"} | named, skew)

    def smaller(self) -> tuple[str, ...]:
        """The models with fewer terms."""
        return tuple(f"division:{n},direction=distort" for n in range(self.count - 1, 0, -1))

    def shapes(self, rays: Array, uv: Array, image_size: tuple[int, int] | None) -> list[Values]:
        """From a pinhole camera to strong barrel distortion."""
        return [{"k1": v} for v in (0.0, 0.05, 0.2)] if self.count else [{}]

    def examples(self) -> list[tuple[Array, tuple[int, int]]]:
        """Barrel and pincushion distortion."""
        skew = [0.7] if self.has_skew else []
        barrel, cushion = [0.2, -0.03, 0.002], [-0.08, 0.03, -0.01]
        fill = [0.0] * MOST_TERMS
        return example_list(
            ([533.0, 534.0, 341.0, 234.0, *skew, *[*barrel, *fill][: self.count]], (640, 480)),
            ([1336.0, 1340.0, 632.0, 519.0, *skew, *[*cushion, *fill][: self.count]], (1280, 1024)),
        )
