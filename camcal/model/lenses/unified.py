"""The unified model and its extension: a projection onto a sphere or an ellipsoid, then from a second centre.

C. Geyer, K. Daniilidis, A unifying theory for central panoramic systems (2000); B. Khomutenko, G. Garcia,
P. Martinet, An enhanced unified camera model, RA-L 1 (2016); as written in V. Usenko, N. Demmel, D. Cremers,
The double sphere camera model, 3DV (2018), eqs. 11 to 16 (ucm), 24 to 29 (eucm):

    d = sqrt(β r² + z²),  R = r / (α d + (1 - α) z)                                                      (1)

`ucm` is β = 1. Valid for z > -w d, with w = α / (1 - α) up to α = 1/2, where it has a pole, and
w = (1 - α) / α from there on, where it folds back.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from camcal.model.lenses.base import Reading, Values, example_list
from camcal.model.lenses.options import no_options
from camcal.model.lenses.parameters import Parameter
from camcal.model.lenses.radial import ALMOST_PI, RadialLens

Array = np.ndarray

ALPHA = Parameter("alpha", "distortion", lower=0.0, upper=1.0)
#: α = 1 is ξ = ∞; 1 - α is taken for at least this, which moves no pixel by more than 1e-9 of its radius
HIGHEST_ALPHA = 1 - 1e-9
#: β = 0 is r / z in front of the camera, whatever α is
LEAST_BETA = 1e-6
BETA = Parameter("beta", "distortion", neutral=1.0, lower=LEAST_BETA)


class Unified(RadialLens):
    """`ucm`, `eucm`."""

    def __init__(self, name: str, skew: bool = False):
        self.enhanced = name == "eucm"
        super().__init__(name, [ALPHA, BETA] if self.enhanced else [ALPHA], skew)

    @classmethod
    def parse(cls, name: str, plain: list[str], named: dict[str, str], skew: bool) -> Unified:
        """No options."""
        no_options(name, plain, named)
        return cls(name, skew)

    def terms(self) -> dict[str, str]:
        """α and β."""
        return {n: n for n in self.names[self._own :]}

    def readings(self, values: Values) -> Iterator[Reading]:
        """Without β also a unit sphere seen from a distance of ξ = α / (1 - α) (`mei`), the focal lengths longer."""
        yield from super().readings(values)
        if values.get("beta", 1.0) == 1.0:
            rest = 1 - min(values["alpha"], HIGHEST_ALPHA)
            longer = {n: values[n] / rest for n in ("fx", "fy", "skew") if n in values}
            yield Reading({"cx": values["cx"], "cy": values["cy"], "xi": 1 / rest - 1} | longer)

    def shapes(self, rays: Array, uv: Array, image_size: tuple[int, int] | None) -> list[Values]:
        """From a pinhole camera over the stereographic one (α = 1/2) to the widest."""
        return [{"alpha": a} for a in (0.0, 0.3, 0.5, 0.6, 0.7, 0.85)]

    def examples(self) -> list[tuple[Array, tuple[int, int]]]:
        """A pole at 132 degrees from the axis, and a fold at 116."""
        skew = [0.8] if self.has_skew else []
        beta = [1.1] if self.enhanced else []
        return example_list(
            ([350.0, 351.0, 318.0, 242.0, *skew, 0.4, *beta], (640, 480)),
            ([300.0, 301.0, 330.0, 230.0, *skew, 0.69, *beta], (640, 480)),
        )

    # ------------------------------------------------------------------ curve
    def curve(self, k: Array, r: Array, z: Array) -> Array:
        """Equation (1)."""
        alpha = float(k[0])
        d = np.sqrt((k[1] if self.enhanced else 1.0) * (r * r) + z * z)
        return r / (alpha * d + (1 - alpha) * z)

    def curve_derivatives(self, k: Array, r: Array, z: Array, d_k: Array) -> tuple[Array, Array, Array]:
        """Derivatives of (1)."""
        alpha, beta = float(k[0]), float(k[1]) if self.enhanced else 1.0
        d = np.sqrt(beta * (r * r) + z * z)
        inverse = 1.0 / (alpha * d + (1 - alpha) * z)
        radius = r * inverse
        slope = radius * inverse
        id_ = 1.0 / d
        np.multiply(z - d, slope, out=d_k[:, 0])
        if self.enhanced:
            np.multiply(slope, (-0.5 * alpha) * (r * r) * id_, out=d_k[:, 1])
        by_r = inverse - slope * (alpha * beta) * r * id_
        return radius, by_r, -slope * (alpha * z * id_ + (1 - alpha))

    def limit(self, k: Array) -> float:
        """Where z = -w d, that is, at tan θ = -sqrt(1 - w²) / (w sqrt β)."""
        alpha, beta = float(k[0]), float(k[1]) if self.enhanced else 1.0
        w = sphere_limit(alpha)
        return min(np.pi - float(np.arctan2(np.sqrt(1 - w * w), w * np.sqrt(beta))), ALMOST_PI)

    def angle(self, k: Array, radius: Array) -> tuple[Array, Array, Array]:
        """Usenko et al., eqs. 13 and 26."""
        alpha, beta = float(k[0]), float(k[1]) if self.enhanced else 1.0
        s = beta * radius * radius
        root = 1 - (2 * alpha - 1) * s
        valid = root > 0
        z = (1 - alpha * alpha * s) / (alpha * np.sqrt(np.where(valid, root, 0.0)) + (1 - alpha))
        return radius, z, valid


def sphere_limit(alpha: float) -> float:
    """w, from 0 to 1: r / (α d + (1 - α) z) grows from the axis up to z = -w d, where it has its pole or its fold."""
    return alpha / (1 - alpha) if alpha <= 0.5 else (1 - alpha) / alpha
