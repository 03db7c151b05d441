"""Lenses that are symmetric about the optical axis: a curve from the angle of a ray to its image radius.

With r² = x² + y²:

    (mx, my) = (x, y) / r · R(r, z)                                                                      (1)

`RadialLens` states R of homogeneous degree 0 in (r, z) and its inverse. `InverseRadialLens` states the angle
θ(R) from the axis instead, and gets R by Newton and its derivatives by the implicit function theorem.
"""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from camcal.model.lenses.base import Lens
from camcal.model.lenses.curve import Inverse, cached

Array = np.ndarray

#: added to r, so that directions x / r are 0 on the axis instead of 0 / 0; far below any r² that counts
TINY = 1e-200
#: the largest half-angle; straight behind there is no image direction
ALMOST_PI = np.pi - 1e-8
#: rad: the largest atan R of the table of an inverse; its tangent, 1e9, is far beyond every picture and still finite
WIDEST = np.pi / 2 - 1e-9


class RadialLens(Lens):
    """A lens of equation (1)."""

    # ------------------------------------------------------------------ what a model states
    @abstractmethod
    def curve(self, k: Array, r: Array, z: Array) -> Array:
        """The image radius R of rays, without a domain check."""

    @abstractmethod
    def curve_derivatives(self, k: Array, r: Array, z: Array, d_k: Array) -> tuple[Array, Array, Array]:
        """R, dR/dr and dR/dz; dR/dk into d_k (V, Q, N)."""

    @abstractmethod
    def angle(self, k: Array, radius: Array) -> tuple[Array, Array, Array]:
        """The ray (r, z), of any length, of an image radius, and which radii have one."""

    @abstractmethod
    def limit(self, k: Array) -> float:
        """The angle of the first fold or pole, rad, at most `ALMOST_PI`."""

    # ------------------------------------------------------------------ map
    def limit_angle(self, params: Array) -> float:
        """The limit of the curve; with a free distortion centre, reduced by the centre's offset."""
        if self.free_centre:
            return super().limit_angle(params)
        return self.limit(params[self._own :])

    def in_domain(self, k: Array, x: Array, y: Array, z: Array) -> Array:
        """Return which points lie at a smaller angle than the limit."""
        return within_cone(self.limit(k), x, y, z)

    def distort(self, k: Array, x: Array, y: Array, z: Array) -> tuple[Array, Array]:
        """Equation (1)."""
        r = np.sqrt(x * x + y * y)
        r += TINY
        scale = self.curve(k, r, z)
        scale /= r
        return x * scale, y * scale

    def derivatives(
        self, k: Array, x: Array, y: Array, z: Array, d_xyz: Array, d_k: Array, fx: float, fy: float
    ) -> tuple[Array, Array, bool]:
        """dR/dr along the radius and R / r across it, which avoids cancellation near the axis."""
        r = np.sqrt(x * x + y * y)
        r += TINY
        c, s = x / r, y / r
        rows = np.empty((len(x), len(k), x.shape[1]))
        radius, by_r, by_z = self.curve_derivatives(k, r, z, rows)
        across = radius / r
        by_r -= across
        for axis, (along, focal) in enumerate(((c, fx), (s, fy))):
            scaled = focal * along
            np.multiply(rows, scaled[:, None], out=d_k[:, :, axis])
            np.multiply(scaled, by_z, out=d_xyz[:, 2, axis])
            scaled *= by_r
            np.multiply(scaled, c, out=d_xyz[:, 0, axis])
            np.multiply(scaled, s, out=d_xyz[:, 1, axis])
            d_xyz[:, axis, axis] += focal * across
        return c * radius, s * radius, bool(within_cone(self.limit(k), r, 0.0, z).all())

    def undistort(self, k: Array, mx: Array, my: Array) -> tuple[Array, Array, Array, Array]:
        """The inverse of (1)."""
        radius = np.sqrt(mx * mx + my * my)
        radius += TINY
        r, z, valid = self.angle(k, radius)
        scale = r / radius
        return mx * scale, my * scale, z, valid


def within_cone(limit: float, x: Array, y: Array | float, z: Array) -> Array:
    """Return which points lie at a smaller angle from the axis than a limit, rad."""
    return np.asarray(np.sqrt(x * x + y * y) * np.cos(limit) < z * np.sin(limit))


class InverseRadialLens(RadialLens):
    """A radial lens defined by the angle of a ray as a function of its image radius."""

    @abstractmethod
    def ray_angle(self, k: Array, radius: Array) -> tuple[Array, Array]:
        """The angle θ of image radii, rad, and dθ/dR."""

    @abstractmethod
    def ray_angle_rows(self, k: Array, radius: Array, d_k: Array) -> None:
        """Write dθ/dk into d_k (V, Q, N)."""

    @abstractmethod
    def reach(self, k: Array) -> float:
        """The image radius up to which θ increases and stays below π; may be inf."""

    @cached
    def limit(self, k: Array) -> float:
        """The angle at `reach`."""
        return min(float(self.ray_angle(k, np.array([self.reach(k)]))[0][0]), ALMOST_PI)

    def curve(self, k: Array, r: Array, z: Array) -> Array:
        """Solve θ(R) = atan2(r, z)."""
        t, _ = self._inverse(k)(np.arctan2(r, z))
        return np.tan(t, out=t)

    @cached
    def _inverse(self, k: Array) -> Inverse:
        """Invert in t = atan R, in which θ is nearly linear."""

        def in_t(t: Array) -> tuple[Array, Array]:
            radius = np.tan(t)
            theta, slope = self.ray_angle(k, radius)
            radius *= radius
            radius += 1.0
            radius *= slope
            return theta, radius

        return Inverse(in_t, min(np.arctan(self.reach(k)), WIDEST))

    def curve_derivatives(self, k: Array, r: Array, z: Array, d_k: Array) -> tuple[Array, Array, Array]:
        """The derivatives by the implicit function theorem on θ(R; k) = atan2(r, z)."""
        radius = self.curve(k, r, z)
        _, slope = self.ray_angle(k, radius)
        self.ray_angle_rows(k, radius, d_k)
        d_k /= -slope[:, None]
        scale = 1.0 / (slope * (r * r + z * z))
        return radius, z * scale, -r * scale

    def angle(self, k: Array, radius: Array) -> tuple[Array, Array, Array]:
        """The ray of an image radius by definition, up to `reach`."""
        theta, _ = self.ray_angle(k, radius)
        return np.sin(theta), np.cos(theta), (radius < self.reach(k)) & (theta < np.pi)
