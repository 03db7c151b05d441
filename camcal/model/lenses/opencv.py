"""OpenCV's polynomial and rational models with 0 to 14 coefficients (docs.opencv.org, camera calibration).

Equations (1) and (2) of `plane` at (a, b) = (x/z, y/z), and with 14 coefficients a tilted sensor (`tilt`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camcal.model.lenses.base import Lens, example_list
from camcal.model.lenses.forms import OpenCVForm, Values
from camcal.model.lenses.options import no_options
from camcal.model.lenses.parameters import Parameter
from camcal.model.lenses.plane import PlaneDistortion
from camcal.model.lenses.rational import fit_rational
from camcal.model.lenses.start import image_radii
from camcal.model.lenses.tilt import tilt_derivatives, tilt_matrix

Array = np.ndarray

#: rad: from here on tan θ is above 19, and its sixth powers leave nothing of the other rays in a least squares fit
WIDEST = np.deg2rad(87)
#: cv2's order of the coefficients, and the terms of `PlaneDistortion` that they are
COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tauX", "tauY")
TERMS = ("n1", "n2", "p1", "p2", "n3", "d1", "d2", "d3", "x1", "x2", "y1", "y2")

_COUNTS = {"pinhole": 0, "opencv4": 4, "opencv5": 5, "opencv8": 8, "opencv12": 12, "opencv14": 14}
ALIASES = {"tilted": "opencv14"}
_FLAGS = {8: ("RATIONAL_MODEL",), 12: ("THIN_PRISM_MODEL",), 14: ("TILTED_MODEL",)}


class PlaneLens(Lens):
    """A lens that distorts the point (x/z, y/z) of the plane z = 1.

    Attributes
    ----------
    plane : PlaneDistortion
        Its terms in the order of the coefficients.
    """

    def __init__(
        self, name: str, names: Sequence[str], terms: Sequence[str], skew: bool, free_centre: bool = False
    ):
        self.plane = PlaneDistortion(tuple(terms))
        super().__init__(name, [Parameter(n, "distortion") for n in names], skew, free_centre)

    @property
    def stackable(self) -> bool:
        """Whether no term mixes the axes: skew, a free centre, higher decentering terms."""
        return not (self.has_skew or self.free_centre or "p3" in self.plane.terms)

    def terms(self) -> dict[str, str]:
        """The terms of the plane distortion, and the distortion centre."""
        own = self.names[self._own :][: len(self.plane.terms)]
        return {n: n for n in self.names[self._bend : self._own]} | dict(
            zip(self.plane.terms, own, strict=True)
        )

    def limit_angle(self, params: Array) -> float:
        """The angle at which the radial part folds, π/2 if it does not; about a free centre, reduced by its
        offset.
        """
        if self.free_centre:
            return super().limit_angle(params)
        return float(np.arctan(self.plane.fold(params[self._own :])))

    def distort(self, k: Array, x: Array, y: Array, z: Array) -> tuple[Array, Array]:
        """Equation (2) of `plane`."""
        iz = 1.0 / z
        return self.plane.apply(k, x * iz, y * iz) if len(k) else (x * iz, y * iz)

    def derivatives(
        self, k: Array, x: Array, y: Array, z: Array, d_xyz: Array, d_k: Array, fx: float, fy: float
    ) -> tuple[Array, Array, bool | Array]:
        """The chain rule through (x/z, y/z)."""
        iz = 1.0 / z
        a, b = x * iz, y * iz
        (xd, yd, xa, xb, ya, yb), grows = self.plane.linearise(k, a, b, d_k, fx, fy)
        ix, iy = fx * iz, fy * iz
        np.multiply(ix, xa, out=d_xyz[:, 0, 0])
        np.multiply(iy, ya, out=d_xyz[:, 0, 1])
        np.multiply(ix, xb, out=d_xyz[:, 1, 0])
        np.multiply(iy, yb, out=d_xyz[:, 1, 1])
        np.negative(a[:, None] * d_xyz[:, 0] + b[:, None] * d_xyz[:, 1], out=d_xyz[:, 2])
        ahead = bool(z.min(initial=np.inf) > 0) if k.ndim == 1 else z.min(1, keepdims=True) > 0
        return xd, yd, grows & ahead

    def in_domain(self, k: Array, x: Array, y: Array, z: Array) -> Array:
        """Return which points lie in front of the camera and before the radial part folds back."""
        fold = self.plane.fold(k)
        return z > 0 if np.isinf(fold) else (z > 0) & (x * x + y * y < (fold * z) ** 2)

    def undistort(self, k: Array, mx: Array, my: Array) -> tuple[Array, Array, Array, Array]:
        """Invert by Newton's method."""
        if not len(k):
            return mx, my, np.ones_like(mx), np.isfinite(mx) & np.isfinite(my)
        a, b, solved = self.plane.invert(k, mx, my)
        return a, b, np.ones_like(a), solved


class OpenCV(PlaneLens):
    """`pinhole`, `opencv4`, `opencv5`, `opencv8`, `opencv12`; `opencv14` is `Tilted`."""

    def __init__(self, name: str, skew: bool = False):
        self.count = _COUNTS[name]
        super().__init__(name, COEFFICIENTS[: self.count], TERMS[: self.count], skew)

    @classmethod
    def parse(cls, name: str, plain: list[str], named: dict[str, str], skew: bool) -> OpenCV:
        """Make the model; it takes no options."""
        no_options(name, plain, named)
        name = ALIASES.get(name, name)
        return (Tilted if name == "opencv14" else OpenCV)(name, skew)

    def smaller(self) -> tuple[str, ...]:
        """The models with fewer coefficients."""
        return tuple(n for n, c in reversed(_COUNTS.items()) if c < self.count)

    def shapes(self, rays: Array, uv: Array, image_size: tuple[int, int] | None) -> list[Values]:
        """Without distortion, and with radial terms computed linearly from the angles at the radii."""
        if not self.count:
            return [{}]
        radius, theta = image_radii(rays, uv, None)
        used = theta < WIDEST
        numerator = [n for n in ("k1", "k2", "k3") if n in self.names]
        denominator = [n for n in ("k4", "k5", "k6") if n in self.names]
        fit = fit_rational(np.tan(theta[used]), radius[used], len(numerator), len(denominator))
        if fit is None:
            return [{}]
        return [{}, dict(zip([*numerator, *denominator], np.concatenate(fit).tolist(), strict=True))]

    def opencv(self, params: Array) -> OpenCVForm:
        """The coefficients in cv2's order, and cv2's flags that free the same coefficients."""
        flags = [f for n, names in _FLAGS.items() if self.count >= n for f in names]
        return OpenCVForm("calibrateCamera", params[self._own :].copy(), tuple(flags))

    def examples(self) -> list[tuple[Array, tuple[int, int]]]:
        """A typical webcam lens, a longer one, and for the larger models their additional terms."""
        webcam = [-0.28, 0.1, 1e-3, -5e-4, -0.02, 0.02, 0.01, 1e-3, 2e-3, -1e-3, -1.5e-3, 1e-3, 0.01, -0.015]
        mild = [0.05, -0.08, -4e-4, 6e-4, 0.02, 0.01, -0.02, 5e-3, -1e-3, 5e-4, 1e-3, -5e-4, -0.02, 0.01]
        skew = [0.7] if self.has_skew else []
        return example_list(
            ([533.0, 534.0, 341.0, 234.0, *skew, *webcam[: self.count]], (640, 480)),
            ([2336.0, 2340.0, 1132.0, 819.0, *skew, *mild[: self.count]], (2272, 1704)),
        )


class Tilted(OpenCV):
    """`opencv14` = `tilted`: `opencv12`, then (xd, yd, 1) ~ tilt(tauX, tauY) (xd, yd, 1)."""

    @property
    def stackable(self) -> bool:
        """No: the homography of the sensor is that of one camera."""
        return False

    def terms(self) -> dict[str, str]:
        """The terms of `opencv12` and the two angles."""
        return super().terms() | {"tauX": "tauX", "tauY": "tauY"}

    def limit_angle(self, params: Array) -> float:
        """The limit of the lens in front of the sensor."""
        return super().limit_angle(params[:-2])

    def in_domain(self, k: Array, x: Array, y: Array, z: Array) -> Array:
        """The domain of the lens in front of the sensor."""
        return super().in_domain(k[:-2], x, y, z)

    def distort(self, k: Array, x: Array, y: Array, z: Array) -> tuple[Array, Array]:
        """Distort, then project onto the tilted sensor."""
        xd, yd = super().distort(k[:-2], x, y, z)
        return _projected(tilt_matrix(*k[-2:]), xd, yd)[:2]

    def undistort(self, k: Array, mx: Array, my: Array) -> tuple[Array, Array, Array, Array]:
        """Invert the homography, then the distortion by Newton's method."""
        xd, yd, _ = _projected(np.linalg.inv(tilt_matrix(*k[-2:])), mx, my)
        return super().undistort(k[:-2], xd, yd)

    def derivatives(
        self, k: Array, x: Array, y: Array, z: Array, d_xyz: Array, d_k: Array, fx: float, fy: float
    ) -> tuple[Array, Array, bool | Array]:
        """The derivatives of the lens through the homography, and those with respect to the angles."""
        xd, yd, inside = super().derivatives(k[:-2], x, y, z, d_xyz, d_k[:, :-2], 1.0, 1.0)
        tilt = tilt_matrix(*k[-2:])
        xt, yt, w = _projected(tilt, xd, yd)
        wx, wy = fx * w, fy * w
        by_x = (tilt[0, 0] - tilt[2, 0] * xt) * wx, (tilt[0, 1] - tilt[2, 1] * xt) * wx
        by_y = (tilt[1, 0] - tilt[2, 0] * yt) * wy, (tilt[1, 1] - tilt[2, 1] * yt) * wy
        for block in (d_k[:, :-2], d_xyz):
            top = by_x[0][:, None] * block[:, :, 0] + by_x[1][:, None] * block[:, :, 1]
            block[:, :, 1] = by_y[0][:, None] * block[:, :, 0] + by_y[1][:, None] * block[:, :, 1]
            block[:, :, 0] = top
        for row, d in zip((-2, -1), tilt_derivatives(*k[-2:]), strict=True):
            dw = d[2, 0] * xd + d[2, 1] * yd + d[2, 2]
            d_k[:, row, 0] = (d[0, 0] * xd + d[0, 1] * yd + d[0, 2] - xt * dw) * wx
            d_k[:, row, 1] = (d[1, 0] * xd + d[1, 1] * yd + d[1, 2] - yt * dw) * wy
        return xt, yt, inside


def _projected(h: Array, x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Apply a homography (3, 3) to points; also return the reciprocal of the third coordinate."""
    w = 1.0 / (h[2, 0] * x + h[2, 1] * y + h[2, 2])
    return (h[0, 0] * x + h[0, 1] * y + h[0, 2]) * w, (h[1, 0] * x + h[1, 1] * y + h[1, 2]) * w, w
