"""Kannala & Brandt's generic lens: a polynomial in the angle from the optical axis.

J. Kannala, S. S. Brandt, A generic camera model and calibration method for conventional, wide-angle, and
fish-eye lenses, PAMI 28 (2006), eq. 6, with the first coefficient taken into the focal length:

    θ = atan2(r, z),  R = θ + k1 θ³ + k2 θ⁵ + ... + kn θ²ⁿ⁺¹                                             (1)

With n = 4 this is cv2.fisheye. Their asymmetric terms (eqs. 7 to 10) are left out, as everywhere.
"""

from __future__ import annotations

import numpy as np

from camcal.errors import UsageError
from camcal.model.lenses.base import OpenCVForm, Parameter, example_list, no_options
from camcal.model.lenses.curve import Inverse, first_root, memo
from camcal.model.lenses.radial import ALMOST_PI, RadialLens

Array = np.ndarray

MOST = 12  #: terms; θ²⁵ at the rim of the widest lens is 1e12
#: tan θ as a series, eq. 1 closest to a pinhole camera
_TANGENT = (1 / 3, 2 / 15, 17 / 315, 62 / 2835)


class KannalaBrandt(RadialLens):
    """`kb4` = `kb:4`, `kb:n`."""

    neutral_curve = "equidistant"

    def __init__(self, name: str, terms: int, skew: bool = False):
        self.terms = terms
        super().__init__(name, [Parameter(f"k{i + 1}", "distortion") for i in range(terms)], skew)

    @classmethod
    def parse(cls, name: str, plain: list[str], named: dict[str, str], skew: bool) -> KannalaBrandt:
        """`kb4` has no options; `kb:n` takes the number of terms, 4 without one."""
        if name == "kb4":
            no_options(name, plain, named)
            return cls(name, 4, skew)
        no_options(name, plain[1:], named)
        text = plain[0] if plain else "4"
        if not text.isdigit() or not 0 <= int(text) <= MOST:
            raise UsageError(f"model 'kb' has no option '{text}': 0 to {MOST} terms.", "Try: --model kb:5")
        return cls(f"kb:{int(text)}", int(text), skew)

    @classmethod
    def variants(cls, name: str) -> tuple[str, ...]:
        """`kb4`, and other numbers of terms."""
        return (name,) if name == "kb4" else ("kb:0", "kb:2", "kb:4", "kb:6")

    def nests(self) -> tuple[str, ...]:
        """The models with fewer terms."""
        fewer = [f"kb:{n}" for n in range(min(self.terms, 5) - 1, -1, -1)]
        return ("kb4", *fewer[1:]) if self.terms > 4 else tuple(fewer)

    def pinhole(self, fx: float, fy: float, cx: float, cy: float, skew: float = 0.0) -> Array:
        """Close to a pinhole camera near the axis: the series of the tangent, as far as there are terms.

        With coefficients of 0 the lens is equidistant (`neutral`).
        """
        params = super().pinhole(fx, fy, cx, cy, skew)
        count = min(self.terms, len(_TANGENT))
        params[self._own : self._own + count] = _TANGENT[:count]
        return params

    def shapes(self, rays: Array, uv: Array, image_size: tuple[int, int] | None) -> list[dict[str, float]]:
        """Equidistant, near stereographic, near equisolid, near perspective."""
        series = (
            (0.0, 0.0),
            (1 / 12, 1 / 120),
            (-1 / 24, 1 / 1920),
            _TANGENT,
        )
        return [{f"k{i + 1}": v for i, v in enumerate(s[: self.terms])} for s in series]

    def opencv(self, params: Array) -> OpenCVForm | None:
        """cv2.fisheye up to four terms, whose alpha is skew / fx."""
        if self.terms > 4:
            return None
        k = np.zeros(4)
        k[: self.terms] = params[self._own :]
        flags = tuple(f"FIX_K{i}" for i in range(self.terms + 1, 5))
        return OpenCVForm("fisheye.calibrate", k, flags, self.names[self._own :])

    def examples(self) -> list[tuple[Array, tuple[int, int]]]:
        """A lens of 150 degrees and one of 195."""
        skew = [0.8] if self.has_skew else []
        wide = [0.02, -0.004, 0.001, -3e-4, 4e-5, -2e-6, *[0.0] * MOST]
        fish = [-0.015, 0.004, -0.003, 4e-4, -2e-5, 1e-6, *[0.0] * MOST]
        return example_list(
            ([558.5, 560.5, 620.5, 381.9, *skew, *wide[: self.terms]], (1280, 800)),
            ([335.0, 337.0, 543.0, 378.0, *skew, *fish[: self.terms]], (1032, 778)),
        )

    # ------------------------------------------------------------------ curve
    def _poly(self, k: Array, theta: Array) -> tuple[Array, Array]:
        """R and dR/dθ of (1)."""
        s = theta * theta
        value, slope = np.zeros_like(s), np.zeros_like(s)
        for i in range(self.terms, 0, -1):
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
        for i in range(self.terms):
            power = np.multiply(power, s, out=d_k[:, i])
        slope /= r * r + z * z
        return value, slope * z, -slope * r

    def limit(self, k: Array) -> float:
        """The first root of dR/dθ."""
        return memo(self, k, self._limit)

    def _limit(self, k: Array) -> float:
        slope = np.array([1.0, *((2 * i + 3) * c for i, c in enumerate(k.tolist()))])
        return min(float(np.sqrt(first_root(slope))), ALMOST_PI)

    def angle(self, k: Array, radius: Array) -> tuple[Array, Array, Array]:
        """Newton in θ; sine and cosine from the tangent of half of it, which is cheaper than both."""
        half, solved = memo(self, k, self._inverse, "inverse")(radius)
        half *= 0.5
        np.tan(half, out=half)
        z = half * half
        np.subtract(1.0, z, out=z)
        half *= 2.0
        return half, z, solved

    def _inverse(self, k: Array) -> Inverse:
        return Inverse(lambda t: self._poly(k, t), self.limit(k))
