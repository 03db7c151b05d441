"""Lenses that state the ray of a pixel, X(p, q), and not the pixel of a ray.

Projection solves X(p, q) = λ x, λ > 0, for (p, q, λ) by Newton, which needs no division by z and so holds all
around. With a = dX/dp, b = dX/dq and D = X · (a x b), the implicit function theorem gives

    dp/dx = λ (b x X) / D,  dq/dx = λ (X x a) / D,  d(p, q)/dk = -(b x X, X x a) / D · dX/dk             (1)

because the rows b x X and X x a are normal to X, so that dλ falls out. The domain is the part about the axis
in which D > 0, that is, in which neighbours stay neighbours.
"""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from camcal.lenses.curve import memo
from camcal.lenses.mapped import MappedLens

Array = np.ndarray

#: directions about the axis in which the extent of the domain is looked for, and radii along each
SPOKES, STEPS = 24, 100
#: Newton stops after a step this small in units of the focal length (the next would be its square), or after
#: so many; a handful suffices unless a point has left the domain
LAST_STEP, ITERATIONS = 1e-9, 20
#: distance from the ray, rad, up to which a pixel counts as found
FOUND = 1e-11


class InverseLens(MappedLens):
    """A lens of equation (1); (p, q) are pixels with the camera matrix taken off."""

    # ------------------------------------------------------------------ what a model has to say
    @abstractmethod
    def ray(self, k: Array, p: Array, q: Array) -> Array:
        """X, its derivatives by p and by q: (3, 3, ...), first axis (X, dX/dp, dX/dq), second (x, y, z)."""

    @abstractmethod
    def ray_rows(self, k: Array, p: Array, q: Array, normal: Array, rows: Array) -> None:
        """Write normal · dX/dk into rows (V, Q, N), for normal (3, V, N)."""

    def farthest(self, k: Array) -> float:
        """How far out, in units of the focal length, the domain is followed."""
        return 20.0

    # ------------------------------------------------------------------ projection
    def _extent(self, k: Array) -> tuple[Array, Array]:
        """The radius up to which D > 0 on each spoke, (SPOKES,), and radii with their mean angles, (2, T)."""
        return memo(self, k, self._find_extent, "extent")

    def _find_extent(self, k: Array) -> tuple[Array, Array]:
        turn = np.arange(SPOKES) * (2 * np.pi / SPOKES)
        radius = np.tan(np.linspace(0, np.arctan(self.farthest(k)), STEPS))
        p, q = radius[:, None] * np.cos(turn), radius[:, None] * np.sin(turn)
        x, a, b = self.ray(k, p, q)
        known = self.pixel_inside(p, q, k)
        ahead = (_triple(x, a, b) > 0) | ~known  # a border is not a fold, and is looked after by itself
        ends = np.where(ahead.all(0), STEPS, ahead.argmin(0))
        reach = radius[np.maximum(ends, 1) - 1]
        angle = np.arctan2(np.hypot(x[0], x[1]), x[2])
        angle[(np.arange(STEPS)[:, None] >= ends) | ~known] = np.nan
        count = np.isfinite(angle).sum(1)
        mean = np.where(count > 0, np.nansum(angle, 1) / np.maximum(count, 1), np.inf)
        used = count > 0
        return reach, np.stack([radius[used], np.maximum.accumulate(mean[used])])

    def pixel_inside(self, p: Array, q: Array, k: Array) -> Array:
        """Where the model says anything; everywhere, unless it has borders."""
        return np.ones(np.broadcast(p, q).shape, bool)

    def _solve(self, k: Array, x: Array, y: Array, z: Array) -> tuple[Array, Array, Array, Array]:
        """p, q, [X, dX/dp, dX/dq] there, and which points are found within the domain."""
        reach, (radii, angles) = self._extent(k)
        r = np.sqrt(x * x + y * y) + 1e-200
        scale = np.interp(np.arctan2(r, z), angles, radii) / r
        p, q = x * scale, y * scale
        target = np.stack([x, y, z]) / np.sqrt(r * r + z * z)
        for _ in range(ITERATIONS):
            state = self.ray(k, p, q)
            dp, dq = _newton_step(state, target)
            # a step that is large beside the radius comes from a poor start
            size = np.abs(dp) + np.abs(dq)
            short = np.minimum(1.0, 0.5 * (0.2 + np.hypot(p, q)) / np.maximum(size, 1e-300))
            p, q = p + short * dp, q + short * dq
            if not (size > LAST_STEP).any():
                break
        state = self.ray(k, p, q)
        return p, q, state, self._found(k, p, q, state, target, reach)

    def _found(self, k: Array, p: Array, q: Array, state: Array, target: Array, reach: Array) -> Array:
        x = state[0]
        norm = np.sqrt((x * x).sum(0))
        off = np.abs(x - norm * target).max(0)
        spoke = np.arctan2(q, p) * (SPOKES / (2 * np.pi)) % SPOKES
        low = (
            np.minimum(spoke.astype(int, casting="unsafe") % SPOKES, SPOKES - 1)
            if spoke.size
            else spoke.astype(int)
        )
        limit = np.minimum(reach[low], reach[(low + 1) % SPOKES])
        ahead = (np.hypot(p, q) <= limit) & (_triple(*state) > 0) & self.pixel_inside(p, q, k)
        return np.asarray((off <= FOUND * norm) & ahead)

    # ------------------------------------------------------------------ MappedLens
    def bend(self, k: Array, x: Array, y: Array, z: Array) -> tuple[Array, Array]:
        """Newton."""
        p, q, _, _ = self._solve(k, x, y, z)
        return p, q

    def bend_inside(self, k: Array, x: Array, y: Array, z: Array) -> Array:
        """Where Newton ends within the domain."""
        return self._solve(k, x, y, z)[3]

    def _project(self, params: Array, x: Array, y: Array, z: Array) -> tuple[Array, Array, Array]:
        """Solves once for pixel and domain."""
        p, q, _, valid = self._solve(params[self._own :], x, y, z)
        u = params[0] * p + params[2]
        if self.has_skew:
            u += params[4] * q
        return u, params[1] * q + params[3], valid

    def bend_derivatives(
        self, k: Array, x: Array, y: Array, z: Array, d_xyz: Array, d_k: Array
    ) -> tuple[Array, Array, bool]:
        """Equation (1)."""
        p, q, (ray, a, b), valid = self._solve(k, x, y, z)
        length = np.sqrt((ray * ray).sum(0) / (x * x + y * y + z * z))
        inverse = 1.0 / _triple(ray, a, b)
        for i, normal in enumerate((_cross(b, ray) * inverse, _cross(ray, a) * inverse)):
            for j in range(3):
                np.multiply(normal[j], length, out=d_xyz[:, j, i])
            self.ray_rows(k, p, q, -normal, d_k[:, :, i])
        return p, q, bool(valid.all())

    def unbend(self, k: Array, mx: Array, my: Array) -> tuple[Array, Array, Array, Array]:
        """As stated."""
        state = self.ray(k, mx, my)
        reach, _ = self._extent(k)
        target = state[0] / np.sqrt((state[0] * state[0]).sum(0))
        x, y, z = state[0]
        return x, y, z, self._found(k, mx, my, state, target, reach)


def _cross(a: Array, b: Array) -> Array:
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _triple(x: Array, a: Array, b: Array) -> Array:
    """x · (a x b)."""
    return (x * _cross(a, b)).sum(0)


def _newton_step(state: Array, target: Array) -> tuple[Array, Array]:
    """Solve X + a dp + b dq = λ target for dp, dq."""
    x, a, b = state
    inverse = -1.0 / _triple(target, a, b)
    return (x * _cross(b, target)).sum(0) * inverse, (x * _cross(target, a)).sum(0) * inverse
