"""The double sphere model: two spheres, their centres ξ apart, then a shifted pinhole camera.

V. Usenko, N. Demmel, D. Cremers, The double sphere camera model, 3DV (2018), eqs. 40 to 50:

    d1 = sqrt(r² + z²),  c = ξ d1 + z,  d2 = sqrt(r² + c²),  R = r / (α d2 + (1 - α) c)                  (1)
"""

from __future__ import annotations

import numpy as np

from camcal.model.lenses.base import Values, example_list
from camcal.model.lenses.options import no_options
from camcal.model.lenses.parameters import Parameter
from camcal.model.lenses.radial import ALMOST_PI, RadialLens
from camcal.model.lenses.unified import ALPHA, sphere_limit

Array = np.ndarray

XI = Parameter("xi", "distortion", lower=-1.0, upper=1.0)


class DoubleSphere(RadialLens):
    """`ds`."""

    #: a sphere apart by ξ < 0 and one by ξ > 0 differ by some hundredths of a pixel
    several_minima = True

    @classmethod
    def parse(cls, name: str, plain: list[str], named: dict[str, str], skew: bool) -> DoubleSphere:
        """No options."""
        no_options(name, plain, named)
        return cls(name, [XI, ALPHA], skew)

    def terms(self) -> dict[str, str]:
        """α as in `ucm`, which is ξ = 0."""
        return {"DoubleSphere.xi": "xi", "alpha": "alpha"}

    def shapes(self, rays: Array, uv: Array, image_size: tuple[int, int] | None) -> list[Values]:
        """Spheres apart by some steps, with and without the second projection."""
        return [{"xi": x, "alpha": a} for x in (-0.2, 0.0, 0.3) for a in (0.05, 0.5, 0.65)]

    def examples(self) -> list[tuple[Array, tuple[int, int]]]:
        """Two lenses of the size of the paper's, on either side of ξ = 0."""
        skew = [0.8] if self.has_skew else []
        return example_list(
            ([365.0, 365.5, 638.0, 514.0, *skew, -0.18, 0.59], (1280, 1024)),
            ([400.0, 401.0, 320.0, 236.0, *skew, 0.25, 0.55], (640, 480)),
        )

    # ------------------------------------------------------------------ curve
    def curve(self, k: Array, r: Array, z: Array) -> Array:
        """Equation (1)."""
        xi, alpha = k.tolist()
        s = r * r
        c = xi * np.sqrt(s + z * z) + z
        return r / (alpha * np.sqrt(s + c * c) + (1 - alpha) * c)

    def curve_derivatives(self, k: Array, r: Array, z: Array, d_k: Array) -> tuple[Array, Array, Array]:
        """Derivatives of (1)."""
        xi, alpha = k.tolist()
        s = r * r
        d1 = np.sqrt(s + z * z)
        c = xi * d1 + z
        d2 = np.sqrt(s + c * c)
        inverse = 1.0 / (alpha * d2 + (1 - alpha) * c)
        radius = r * inverse
        slope = radius * inverse
        by_c = alpha * c / d2 + (1 - alpha)  # of the denominator
        id1 = 1.0 / d1
        np.multiply(slope * by_c, -d1, out=d_k[:, 0])
        np.multiply(slope, c - d2, out=d_k[:, 1])
        by_r = inverse - slope * r * (alpha / d2 + by_c * xi * id1)
        return radius, by_r, -slope * by_c * (1 + xi * z * id1)

    def limit(self, k: Array) -> float:
        """Where c = -w d2, the pole or fold of the second projection: (1) grows with the angle at the second centre,
        and that, for |ξ| < 1, with the angle at the first.

        With d1 = 1 and z = cos θ the condition is cos² θ + 2 ξ (1 - w²) cos θ + ξ² - w² (1 + ξ²) = 0. The paper's
        bound (eqs. 43 to 45) lies up to 4 degrees before it.
        """
        xi, alpha = k.tolist()
        w = sphere_limit(alpha)
        inner = xi * (1 - w * w)
        cosine = -inner - w * np.sqrt(max(1 - xi * inner, 0.0))
        return min(float(np.arccos(np.clip(cosine, -1, 1))), ALMOST_PI)

    def angle(self, k: Array, radius: Array) -> tuple[Array, Array, Array]:
        """Equations 46 to 50."""
        xi, alpha = k.tolist()
        s = radius * radius
        root = 1 - (2 * alpha - 1) * s
        valid = root > 0
        z = (1 - alpha * alpha * s) / (alpha * np.sqrt(np.where(valid, root, 0.0)) + (1 - alpha))
        under = z * z + (1 - xi * xi) * s
        scale = (z * xi + np.sqrt(np.maximum(under, 0.0))) / (z * z + s)
        return scale * radius, scale * z - xi, valid & (under >= 0) & (scale > 0)
