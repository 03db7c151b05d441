"""Kannala & Brandt's generic lens: a polynomial in the angle from the optical axis.

J. Kannala, S. S. Brandt, A generic camera model and calibration method for conventional, wide-angle, and
fish-eye lenses, PAMI 28 (2006), eq. 6, with the first coefficient taken into the focal length:

    θ = atan2(r, z),  R = θ + k1 θ³ + k2 θ⁵ + ... + kn θ²ⁿ⁺¹                                             (1)

With n = 4 this is cv2.fisheye. Their asymmetric terms (eqs. 7 to 10) are left out, as everywhere.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from camcal.model.lenses.base import example_list
from camcal.model.lenses.curve import Inverse, cached, first_root
from camcal.model.lenses.forms import OpenCVForm, Reading, Values
from camcal.model.lenses.options import count_option, no_options
from camcal.model.lenses.parameters import Parameter
from camcal.model.lenses.radial import ALMOST_PI, RadialLens

Array = np.ndarray

CV2_TERMS = 4  #: k1 to k4 of cv2.fisheye
MOST = 12  #: terms; θ²⁵ at the rim of the widest lens is 1e12
#: tan θ as a series, eq. 1 closest to a pinhole camera
_TANGENT = (1 / 3, 2 / 15, 17 / 315, 62 / 2835)


class KannalaBrandt(RadialLens):
    """`kb4` = `kb:4`, `kb:n`."""

    neutral_curve = "equidistant"

    def __init__(self, name: str, count: int, skew: bool = False):
        self.count = count
        super().__init__(name, [Parameter(f"k{i + 1}", "distortion") for i in range(count)], skew)

    @classmethod
    def parse(cls, name: str, plain: list[str], named: dict[str, str], skew: bool) -> KannalaBrandt:
        """Parse `kb4` (no options) or `kb:n` with n terms; 4 by default."""
        if name == "kb4":
            no_options(name, plain, named)
            return cls(name, 4, skew)
        no_options(name, plain[1:], named)
        terms = count_option(name, plain, 4, 0, MOST)
        return cls(f"kb:{terms}", terms, skew)

    def smaller(self) -> tuple[str, ...]:
        """The models with fewer terms."""
        return tuple("kb4" if n == 4 else f"kb:{n}" for n in range(self.count - 1, -1, -1))

    def terms(self) -> dict[str, str]:
        """The powers of θ."""
        return {f"t{2 * i + 3}": n for i, n in enumerate(self.names[self._own :])}

    def readings(self, values: Values) -> Iterator[Reading]:
        """The equidistant lens, R = θ, is a field-of-view lens with 2 tan(w/2) = 1 and w times its focal length."""
        (own,) = super().readings(values)
        yield own
        if not any(t in own.terms for t in self.terms()):
            w = 2 * np.arctan(0.5)
            matrix = {n: v * (w if n in ("fx", "fy", "skew") else 1.0) for n, v in own.terms.items()}
            yield Reading(matrix | {"w": w})

    def pinhole(self, fx: float, fy: float, cx: float, cy: float, skew: float = 0.0) -> Array:
        """Close to a pinhole camera near the axis: the series of the tangent, truncated to the available terms.

        With coefficients of 0 the lens is equidistant (`neutral`).
        """
        params = super().pinhole(fx, fy, cx, cy, skew)
        count = min(self.count, len(_TANGENT))
        params[self._own : self._own + count] = _TANGENT[:count]
        return params

    def shapes(self, rays: Array, uv: Array, image_size: tuple[int, int] | None) -> list[Values]:
        """Equidistant, nearly stereographic, nearly equisolid, nearly perspective."""
        series = (
            (0.0, 0.0),
            (1 / 12, 1 / 120),
            (-1 / 24, 1 / 1920),
            _TANGENT,
        )
        return [{f"k{i + 1}": v for i, v in enumerate(s[: self.count])} for s in series]

    def opencv(self, params: Array) -> OpenCVForm | None:
        """cv2.fisheye up to four terms, whose alpha is skew / fx."""
        if self.count > CV2_TERMS:
            return None
        k = np.zeros(CV2_TERMS)
        k[: self.count] = params[self._own :]
        flags = tuple(f"FIX_K{i}" for i in range(self.count + 1, CV2_TERMS + 1))
        return OpenCVForm("fisheye.calibrate", k, flags)

    def examples(self) -> list[tuple[Array, tuple[int, int]]]:
        """A lens of 150 degrees and one of 195 degrees."""
        skew = [0.8] if self.has_skew else []
        wide = [0.02, -0.004, 0.001, -3e-4, 4e-5, -2e-6, *[0.0] * MOST]
        fish = [-0.015, 0.004, -0.003, 4e-4, -2e-5, 1e-6, *[0.0] * MOST]
        return example_list(
            ([558.5, 560.5, 620.5, 381.9, *skew, *wide[: self.count]], (1280, 800)),
            ([335.0, 337.0, 543.0, 378.0, *skew, *fish[: self.count]], (1032, 778)),
        )

    # ------------------------------------------------------------------ curve
    def _poly(self, k: Array, theta: Array) -> tuple[Array, Array]:
        """R and dR/dθ of (1)."""
        s = theta * theta
        value, slope = np.zeros_like(s), np.zeros_like(s)
        for i in range(self.count, 0, -1):
            c = float(k[i - 1])
            value += c
            value *= s
            slope += (2 * i + 1) * c
            slope *= s
        value += 1.0
        slope += 1.0
        value *= theta
        return value, slope

    def curve(self, k: Array, r: Array, z: Array) -> Array:
        """Equation (1)."""
        theta = np.arctan2(r, z)
        s = theta * theta
        value = np.zeros_like(s)
        for c in k[::-1].tolist():
            value += c
            value *= s
        value += 1.0
        value *= theta
        return value

    def curve_derivatives(self, k: Array, r: Array, z: Array, d_k: Array) -> tuple[Array, Array, Array]:
        """dR/dθ through dθ = (z dr - r dz) / (r² + z²)."""
        theta = np.arctan2(r, z)
        value, slope = self._poly(k, theta)
        power, s = theta, theta * theta
        for i in range(self.count):
            power = np.multiply(power, s, out=d_k[:, i])
        slope /= r * r + z * z
        return value, slope * z, -slope * r

    @cached
    def limit(self, k: Array) -> float:
        """The first root of dR/dθ."""
        slope = np.array([1.0, *((2 * i + 3) * c for i, c in enumerate(k.tolist()))])
        return min(float(np.sqrt(first_root(slope))), ALMOST_PI)

    def angle(self, k: Array, radius: Array) -> tuple[Array, Array, Array]:
        """Newton's method in θ; sine and cosine come from the tangent of θ/2, which is cheaper than computing
        both.
        """
        half, solved = self._inverse(k)(radius)
        half *= 0.5
        np.tan(half, out=half)
        z = half * half
        np.subtract(1.0, z, out=z)
        half *= 2.0
        return half, z, solved

    @cached
    def _inverse(self, k: Array) -> Inverse:
        return Inverse(lambda t: self._poly(k, t), self.limit(k))
