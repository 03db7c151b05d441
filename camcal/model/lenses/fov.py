"""The field-of-view model: image radius proportional to the angle after a change of focal length.

F. Devernay, O. Faugeras, Straight lines have to be straight (2001), eqs. 13 and 14, carried on beyond 90
degrees as in Usenko et al. (2018), eq. 33:

    R = atan2(2 r tan(w / 2), z) / w                                                                     (1)

w = 0 is a pinhole camera; R depends on w², so its derivative there is 0 and a fit has to begin elsewhere.
"""

from __future__ import annotations

import numpy as np

from camcal.model.lenses.base import example_list
from camcal.model.lenses.forms import Values
from camcal.model.lenses.options import no_options
from camcal.model.lenses.parameters import Parameter
from camcal.model.lenses.radial import ALMOST_PI, RadialLens

Array = np.ndarray

#: below this w, dR/dw is taken from its series, whose error w³ then equals what is lost by cancellation
SMALL = 1e-4
#: rad: w to begin from where nothing is known of it; at 45 degrees from the axis it moves a point by 1 %
FIRST = 0.2


class FieldOfView(RadialLens):
    """`fov`."""

    @classmethod
    def parse(cls, name: str, plain: list[str], named: dict[str, str], skew: bool) -> FieldOfView:
        """Reject any option."""
        no_options(name, plain, named)
        return cls(name, [Parameter("w", "distortion", lower=0.0, upper=3.1)], skew)

    def terms(self) -> dict[str, str]:
        """The field of view."""
        return {"w": "w"}

    def pinhole(self, fx: float, fy: float, cx: float, cy: float, skew: float = 0.0) -> Array:
        """Close to a pinhole camera, but w > 0: dR/dw = 0 at w = 0, where a refinement would not move."""
        params = super().pinhole(fx, fy, cx, cy, skew)
        params[self._own] = FIRST
        return params

    def shapes(self, rays: Array, uv: Array, image_size: tuple[int, int] | None) -> list[Values]:
        """From narrow to wide fields of view."""
        return [{"w": w} for w in (FIRST, 0.6, 0.95, 1.3, 1.8)]

    def examples(self) -> list[tuple[Array, tuple[int, int]]]:
        """A lens of 150 degrees and a mild one."""
        skew = [0.8] if self.has_skew else []
        return example_list(
            ([300.0, 301.0, 318.0, 242.0, *skew, 0.93], (640, 480)),
            ([520.0, 522.0, 330.0, 230.0, *skew, 0.4], (640, 480)),
        )

    # ------------------------------------------------------------------ curve
    def curve(self, k: Array, r: Array, z: Array) -> Array:
        """Equation (1)."""
        w = float(k[0])
        if w == 0.0:
            return r / z
        return np.arctan2(2 * np.tan(w / 2) * r, z) / w

    def curve_derivatives(self, k: Array, r: Array, z: Array, d_k: Array) -> tuple[Array, Array, Array]:
        """Derivatives of (1)."""
        w = float(k[0])
        q = 2 * np.tan(w / 2)
        radius = self.curve(k, r, z)
        common = 1.0 / (z * z + (q * q) * (r * r))
        ratio = q / w if w else 1.0
        if w < SMALL:  # R = a + w² (a / 12 - a³ / 3) + ..., a = r / z
            a = r / z
            np.multiply(a, (2 * w) * (1 / 12 - a * a / 3), out=d_k[:, 0])
        else:
            by_w = 1 + 0.25 * q * q  # dq/dw = 1 / cos²(w/2)
            np.subtract(by_w * r * z * common, radius, out=d_k[:, 0])
            d_k[:, 0] /= w
        return radius, ratio * z * common, -ratio * r * common

    def limit(self, k: Array) -> float:
        """All directions for w > 0, those in front of the camera for w = 0."""
        return ALMOST_PI if k[0] > 0 else np.pi / 2

    def angle(self, k: Array, radius: Array) -> tuple[Array, Array, Array]:
        """r = sin(w R), z = 2 tan(w / 2) cos(w R)."""
        w = float(k[0])
        if w == 0.0:
            return radius, np.ones_like(radius), np.isfinite(radius)
        q = 2 * np.tan(w / 2)
        return np.sin(w * radius) / q, np.cos(w * radius), w * radius < np.pi
