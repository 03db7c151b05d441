"""Mei & Rives' omnidirectional model: the unit sphere seen from a point at distance ξ above its centre, then
distortion.

C. Mei, P. Rives, Single view point omnidirectional camera calibration from planar grids, ICRA (2007),
section II; cv2.omnidir. With d = |(x, y, z)|:

    a = x / (z + ξ d),  b = y / (z + ξ d)                                                                (1)

and equation (1) of `plane` with k1, k2, p1, p2 at (a, b).
"""

from __future__ import annotations

import numpy as np

from camcal.model.lenses.base import Lens, example_list
from camcal.model.lenses.curve import cached
from camcal.model.lenses.forms import OpenCVForm, Values
from camcal.model.lenses.options import no_options
from camcal.model.lenses.parameters import Parameter
from camcal.model.lenses.plane import PlaneDistortion
from camcal.model.lenses.radial import ALMOST_PI, within_cone

Array = np.ndarray


class Mei(Lens):
    """`mei`: xi, k1, k2, p1, p2."""

    plane = PlaneDistortion(("n1", "n2", "p1", "p2"))
    #: ξ and k1 can stand for each other: on the set ov_plane minima lie at 0.481 and 0.500 px
    several_minima = True

    @classmethod
    def parse(cls, name: str, plain: list[str], named: dict[str, str], skew: bool) -> Mei:
        """Reject any option."""
        no_options(name, plain, named)
        own = [Parameter("xi", "distortion", lower=0.0)]
        return cls(name, own + [Parameter(n, "distortion") for n in ("k1", "k2", "p1", "p2")], skew)

    def smaller(self) -> tuple[str, ...]:
        """The sphere without distortion."""
        return ("ucm",)

    def terms(self) -> dict[str, str]:
        """ξ and the terms of the plane distortion."""
        return {"xi": "xi"} | dict(zip(self.plane.terms, self.names[self._own + 1 :], strict=True))

    def shapes(self, rays: Array, uv: Array, image_size: tuple[int, int] | None) -> list[Values]:
        """From a pinhole camera to the stereographic one (ξ = 1) and beyond."""
        return [{"xi": xi} for xi in (0.0, 0.5, 1.0, 1.6, 2.5)]

    def opencv(self, params: Array) -> OpenCVForm:
        """cv2.omnidir, whose matrix contains the skew."""
        xi, *bend = params[self._own :].tolist()
        return OpenCVForm("omnidir.calibrate", np.array(bend), xi=xi)

    def examples(self) -> list[tuple[Array, tuple[int, int]]]:
        """A fisheye lens and a mild one."""
        skew = [0.8] if self.has_skew else []
        return example_list(
            ([820.0, 822.0, 655.0, 490.0, *skew, 1.3, -0.12, 0.03, 8e-4, -6e-4], (1280, 960)),
            ([560.0, 561.0, 318.0, 242.0, *skew, 0.6, -0.08, 0.01, -5e-4, 4e-4], (640, 480)),
        )

    # ------------------------------------------------------------------ map
    def distort(self, k: Array, x: Array, y: Array, z: Array) -> tuple[Array, Array]:
        """Equation (1), then the distortion."""
        scale = 1.0 / (z + k[0] * np.sqrt(x * x + y * y + z * z))
        return self.plane.apply(k[1:], x * scale, y * scale)

    def derivatives(
        self, k: Array, x: Array, y: Array, z: Array, d_xyz: Array, d_k: Array, fx: float, fy: float
    ) -> tuple[Array, Array, bool | Array]:
        """The chain rule through (a, b)."""
        xi = float(k[0])
        d = np.sqrt(x * x + y * y + z * z)
        scale = 1.0 / (z + xi * d)
        a, b = x * scale, y * scale
        (xd, yd, xa, xb, ya, yb), grows = self.plane.linearise(k[1:], a, b, d_k[:, 1:], fx, fy)
        xa, xb, ya, yb = fx * xa, fx * xb, fy * ya, fy * yb
        # d(a, b) = scale (dx, dy) - (a, b) scale (dz + ξ dd + d dξ)
        along_x, along_y = a * xa + b * xb, a * ya + b * yb
        slope = scale * xi / d
        for i, (c, direct) in enumerate(((x, (xa, ya)), (y, (xb, yb)))):
            np.subtract(direct[0] * scale, along_x * slope * c, out=d_xyz[:, i, 0])
            np.subtract(direct[1] * scale, along_y * slope * c, out=d_xyz[:, i, 1])
        down = -(scale + slope * z)
        np.multiply(along_x, down, out=d_xyz[:, 2, 0])
        np.multiply(along_y, down, out=d_xyz[:, 2, 1])
        np.multiply(along_x, -scale * d, out=d_k[:, 0, 0])
        np.multiply(along_y, -scale * d, out=d_k[:, 0, 1])
        return xd, yd, grows and bool(self.in_domain(k, x, y, z).all())

    @cached
    def _limit(self, k: Array) -> float:
        """The angle of the fold of (1), of its pole, or of the fold of the distortion, whichever comes first, rad."""
        xi = float(k[0])
        limit = float(np.arccos(-min(xi, 1 / xi if xi > 0 else 0.0)))
        fold = self.plane.fold(k[1:])
        if np.isfinite(fold):
            # sin t = fold (cos t + ξ); within the limit the left side over the right grows with t
            reach = np.hypot(1, fold)
            if fold * xi < reach:
                limit = min(limit, float(np.arctan(fold) + np.arcsin(fold * xi / reach)))
        return min(limit, ALMOST_PI)

    def limit_angle(self, params: Array) -> float:
        """See `_limit`."""
        return self._limit(params[self._own :])

    def in_domain(self, k: Array, x: Array, y: Array, z: Array) -> Array:
        """Return which points lie at a smaller angle than the limit."""
        return within_cone(self._limit(k), x, y, z)

    def undistort(self, k: Array, mx: Array, my: Array) -> tuple[Array, Array, Array, Array]:
        """Invert the distortion by Newton's method, then the sphere (Mei & Rives, eq. 4), scaled to stay exact for
        small ξ.
        """
        xi = float(k[0])
        a, b, solved = self.plane.invert(k[1:], mx, my)
        s = a * a + b * b
        root = 1 + (1 - xi * xi) * s
        valid = solved & (root > 0)
        scale = (xi + np.sqrt(np.maximum(root, 0.0))) / (1 + s)
        return scale * a, scale * b, scale - xi, valid
