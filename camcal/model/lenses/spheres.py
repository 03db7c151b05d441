"""Projections via spheres: the unified model, the enhanced unified model, and the double sphere.

C. Geyer, K. Daniilidis, A unifying theory for central panoramic systems (2000); B. Khomutenko, G. Garcia,
P. Martinet, An enhanced unified camera model, RA-L 1 (2016); V. Usenko, N. Demmel, D. Cremers, The double sphere
camera model, 3DV (2018), eqs. 11 to 16 (ucm), 24 to 29 (eucm), 40 to 50 (ds):

    c = z + ξ sqrt(r² + z²),  d = sqrt(β r² + c²),  R = r / (α d + (1 - α) c)                            (1)

`ucm` is ξ = 0 and β = 1, `eucm` ξ = 0, `ds` β = 1. R grows from the axis up to

    c = -w d,  w = α / (1 - α) up to α = 1/2 (a pole),  w = (1 - α) / α from there on (a fold)           (2)

because R grows up to there with the angle atan2(r, c), and that, for |ξ| < 1, with the angle of the ray.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from camcal.model.lenses.base import Lens, example_list
from camcal.model.lenses.forms import Reading, Values
from camcal.model.lenses.options import no_options
from camcal.model.lenses.parameters import Parameter
from camcal.model.lenses.radial import ALMOST_PI, RadialLens

Array = np.ndarray

ALPHA = Parameter("alpha", "distortion", lower=0.0, upper=1.0)
#: the focal length on the axis is fx / (1 + ξ): ξ = -1 has none
LEAST_XI = -0.999
XI = Parameter("xi", "distortion", lower=LEAST_XI, upper=1.0)
#: β = 0 is r / z in front of the camera, whatever α is
LEAST_BETA = 1e-6
BETA = Parameter("beta", "distortion", neutral=1.0, lower=LEAST_BETA)
#: α = 1 of `ucm` is ξ = ∞ of `mei`; 1 - α is taken for at least this, which moves no pixel by more than 1e-9 of its
#: radius
HIGHEST_ALPHA = 1 - 1e-9

OWN = {"ucm": (ALPHA,), "eucm": (ALPHA, BETA), "ds": (XI, ALPHA)}


class Spheres(RadialLens):
    """`ucm`, `eucm`, `ds`."""

    def __init__(self, name: str, skew: bool = False):
        super().__init__(name, OWN[name], skew)
        #: of `ds`, spheres apart by ξ < 0 and by ξ > 0 differ by some hundredths of a pixel
        self.several_minima = name == "ds"

    @classmethod
    def parse(cls, name: str, plain: list[str], named: dict[str, str], skew: bool) -> Lens:
        """Reject any option."""
        no_options(name, plain, named)
        return cls(name, skew)

    def terms(self) -> dict[str, str]:
        """α, β, and the distance of the spheres."""
        return {"spheres" if p is XI else p.name: p.name for p in OWN[self.name]}

    def readings(self, values: Values) -> Iterator[Reading]:
        """`ucm` is also `mei`'s sphere, seen from a distance ξ = α / (1 - α), with longer focal lengths."""
        yield from super().readings(values)
        if values.get("beta", 1.0) == 1.0 and values.get("xi", 0.0) == 0.0:
            rest = 1 - min(values["alpha"], HIGHEST_ALPHA)
            longer = {n: values[n] / rest for n in ("fx", "fy", "skew") if n in values}
            yield Reading({"cx": values["cx"], "cy": values["cy"], "xi": 1 / rest - 1} | longer)

    def shapes(self, rays: Array, uv: Array, image_size: tuple[int, int] | None) -> list[Values]:
        """From a pinhole camera via the stereographic one (α = 1/2) to the widest; for `ds`, several sphere
        distances.
        """
        if self.name == "ds":
            return [{"xi": x, "alpha": a} for x in (-0.2, 0.0, 0.3) for a in (0.05, 0.5, 0.65)]
        return [{"alpha": a} for a in (0.0, 0.3, 0.5, 0.6, 0.7, 0.85)]

    def examples(self) -> list[tuple[Array, tuple[int, int]]]:
        """A pole at 132 degrees from the axis, and a fold at 116; for `ds`, two lenses like those of the paper."""
        skew = [0.8] if self.has_skew else []
        if self.name == "ds":
            return example_list(
                ([365.0, 365.5, 638.0, 514.0, *skew, -0.18, 0.59], (1280, 1024)),
                ([400.0, 401.0, 320.0, 236.0, *skew, 0.25, 0.55], (640, 480)),
            )
        beta = [1.1] if self.name == "eucm" else []
        return example_list(
            ([350.0, 351.0, 318.0, 242.0, *skew, 0.4, *beta], (640, 480)),
            ([300.0, 301.0, 330.0, 230.0, *skew, 0.69, *beta], (640, 480)),
        )

    # ------------------------------------------------------------------ curve
    def _values(self, k: Array) -> tuple[float, float, float]:
        """ξ, α, β."""
        values = {p.name: float(v) for p, v in zip(OWN[self.name], k, strict=True)}
        return values.get("xi", 0.0), values["alpha"], values.get("beta", 1.0)

    def curve(self, k: Array, r: Array, z: Array) -> Array:
        """Equation (1)."""
        xi, alpha, beta = self._values(k)
        s = r * r
        c = xi * np.sqrt(s + z * z) + z if xi else z
        return r / (alpha * np.sqrt(beta * s + c * c) + (1 - alpha) * c)

    def curve_derivatives(self, k: Array, r: Array, z: Array, d_k: Array) -> tuple[Array, Array, Array]:
        """Derivatives of (1), those of its denominator first."""
        xi, alpha, beta = self._values(k)
        s = r * r
        d1 = np.sqrt(s + z * z) if XI in OWN[self.name] else None
        c = z if d1 is None else xi * d1 + z
        d = np.sqrt(beta * s + c * c)
        inverse = 1.0 / (alpha * d + (1 - alpha) * c)
        radius = r * inverse
        slope = radius * inverse
        by_c = (alpha / d) * c + (1 - alpha)
        by_r, by_z = (alpha * beta / d) * r, by_c
        if d1 is not None:
            by_r, by_z = by_r + by_c * (xi / d1) * r, by_c * (1 + (xi / d1) * z)
        for i, p in enumerate(OWN[self.name]):
            if p is XI:
                by_k = by_c * d1
            else:
                by_k = d - c if p is ALPHA else (0.5 * alpha) * s / d
            np.multiply(slope, -by_k, out=d_k[:, i])
        return radius, inverse - slope * by_r, -slope * by_z

    def limit(self, k: Array) -> float:
        """The limit where (2) holds: a quadratic equation for cos θ.

        The bound of Usenko et al. for `ds` (eqs. 43 to 45) lies up to 4 degrees before it.
        """
        xi, alpha, beta = self._values(k)
        w = alpha / (1 - alpha) if alpha <= 0.5 else (1 - alpha) / alpha
        a, b = 1 - w * w, w * w * beta
        cosine = -(a * xi + np.sqrt(max(b * (a + b - a * xi * xi), 0.0))) / (a + b)
        return min(float(np.arccos(np.clip(cosine, -1, 1))), ALMOST_PI)

    def angle(self, k: Array, radius: Array) -> tuple[Array, Array, Array]:
        """Usenko et al., eqs. 13, 26 and 46 to 50: c of r = R, then the point of the sphere on that line."""
        xi, alpha, beta = self._values(k)
        s = radius * radius
        root = 1 - ((2 * alpha - 1) * beta) * s
        valid = root > 0
        c = (1 - (alpha * alpha * beta) * s) / (alpha * np.sqrt(np.where(valid, root, 0.0)) + (1 - alpha))
        if not xi:
            return radius, c, valid
        under = c * c + (1 - xi * xi) * s
        scale = (c * xi + np.sqrt(np.maximum(under, 0.0))) / (c * c + s)
        return scale * radius, scale * c - xi, valid & (under >= 0) & (scale > 0)
