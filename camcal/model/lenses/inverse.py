"""Lenses defined by the ray of a pixel, X(p, q), rather than by the pixel of a ray.

Projection solves X(p, q) = λ x, λ > 0, for (p, q, λ) by Newton, which needs no division by z and so holds all
around. With a = dX/dp, b = dX/dq and D = X · (a x b), the implicit function theorem gives

    dp/dx = λ (b x X) / D,  dq/dx = λ (X x a) / D,  d(p, q)/dk = -(b x X, X x a) / D · dX/dk             (1)

because the rows b x X and X x a are normal to X, so that dλ falls out. The domain is the part about the axis
in which D > 0, that is, in which neighbours stay neighbours.
"""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from camcal.geometry.numbers import TINY
from camcal.model.lenses.base import Lens
from camcal.model.lenses.curve import cached

Array = np.ndarray

#: directions about the axis in which the extent of the domain is looked for, every 15 degrees; radii along each, even
#: in angle, and between two of these: the domain ends at most 1/32 of a step, under 0.03 degrees, before its fold
SPOKES, STEPS, FINER = 24, 100, 33
#: cells of the table of radii over 180 degrees, a third of a degree each: less than what the asymmetry leaves
CELLS = 512
#: Newton stops after a step this small in units of the focal length: the next would be its square, below the rounding
LAST_STEP = 1e-9
#: steps with all points, which decide the time alone, and with those that have not arrived, whose steps are shortened
#: (`LONG`): six of these are enough for what is within 1e-7 of a fold
QUICK, ITERATIONS = 5, 20
#: in focal lengths: steps beyond this come from a poor start, and are shortened to half of the radius (and 0.2)
LONG, SPAN = 0.1, 0.2


class InverseLens(Lens):
    """A lens of equation (1); (p, q) are pixels with the camera matrix removed."""

    # ------------------------------------------------------------------ what a model states
    @abstractmethod
    def ray(self, k: Array, p: Array, q: Array) -> Array:
        """X, its derivatives by p and by q: (3, 3, ...), first axis (X, dX/dp, dX/dq), second (x, y, z)."""

    @abstractmethod
    def ray_rows(self, k: Array, p: Array, q: Array, normal: Array, rows: Array) -> None:
        """Write normal · dX/dk into rows (V, Q, N), for normal (3, V, N)."""

    def farthest(self, k: Array) -> float:
        """How far out the domain is traced, in focal lengths: 87 degrees of a perspective lens."""
        return 20.0

    # ------------------------------------------------------------------ projection
    @cached
    def _extent(self, k: Array) -> tuple[Array, Array]:
        """The radius up to which D > 0 on each spoke, (SPOKES,), and radii of equally spaced mean angles, (CELLS +
        1,).
        """
        radius = np.tan(np.linspace(0, np.arctan(self.farthest(k)), STEPS))
        coarse = np.broadcast_to(radius[:, None], (STEPS, SPOKES))
        ends, x, known = self._until_fold(k, coarse)
        # once more between the last place before the fold and the first beyond
        last, beyond = (radius[np.clip(ends - back, 0, STEPS - 1)] for back in (1, 0))
        fine = last + np.linspace(0, 1, FINER)[:, None] * (beyond - last)
        reach = np.take_along_axis(fine, np.maximum(self._until_fold(k, fine)[0], 1)[None] - 1, 0)[0]
        angle = np.arctan2(np.hypot(x[0], x[1]), x[2])
        angle[(np.arange(STEPS)[:, None] >= ends) | ~known] = np.nan
        count = np.isfinite(angle).sum(1)
        mean = np.where(count > 0, np.nansum(angle, 1) / np.maximum(count, 1), np.inf)
        used = count > 0
        if not used.any():  # a surface that is folded everywhere sees nothing
            return reach, np.zeros(CELLS + 1)
        even = np.linspace(0, np.pi, CELLS + 1)
        return reach, np.interp(even, np.maximum.accumulate(mean[used]), radius[used])

    def _until_fold(self, k: Array, radius: Array) -> tuple[Array, Array, Array]:
        """Return how many of the radii (R, SPOKES) lie before the fold; the rays there, and where they are known."""
        turn = np.arange(SPOKES) * (2 * np.pi / SPOKES)
        p, q = radius * np.cos(turn), radius * np.sin(turn)
        x, a, b = self.ray(k, p, q)
        known = self.pixel_inside(p, q, k)
        ahead = (_triple(x, a, b) > 0) | ~known  # a border is not a fold, and is looked after by itself
        return np.where(ahead.all(0), len(radius), ahead.argmin(0)), x, known

    def pixel_inside(self, p: Array, q: Array, k: Array) -> Array:
        """Return where the model is defined: everywhere, unless it has borders."""
        return np.ones(np.broadcast(p, q).shape, bool)

    def _solve(self, k: Array, x: Array, y: Array, z: Array) -> tuple[Array, Array, Array]:
        """Solve for p, q; also return which points were found within the domain."""
        _, radii = self._extent(k)
        r = np.sqrt(x * x + y * y) + 1e-200
        place = np.arctan2(r, z) * (CELLS / np.pi)
        cell = place.astype(np.intp)
        below = radii.take(cell, mode="clip")
        scale = (below + (place - cell) * (radii.take(cell + 1, mode="clip") - below)) / r
        p, q = x * scale, y * scale
        target = np.stack([x, y, z]) / np.sqrt(r * r + z * z)
        solved, ahead = self._iterate(k, p, q, target, QUICK)
        if not solved.all():  # next to a fold, or outside
            rest = ~solved
            some = p[rest], q[rest]
            solved[rest], ahead[rest] = self._iterate(k, *some, target[:, rest], ITERATIONS)
            p[rest], q[rest] = some
        return p, q, solved & ahead & self._within(k, p, q)

    def _iterate(self, k: Array, p: Array, q: Array, target: Array, most: int) -> tuple[Array, Array]:
        """Newton's method on p, q in place; return which points converged, and which of them with D > 0."""
        for _ in range(most):
            dp, dq, ahead = _newton_step(self.ray(k, p, q), target)
            size = np.abs(dp) + np.abs(dq)
            if size.max(initial=0.0) > LONG:
                short = np.minimum(1.0, 0.5 * (SPAN + np.hypot(p, q)) / np.maximum(size, TINY))
                dp, dq = short * dp, short * dq
            p += dp
            q += dq
            if not (size > LAST_STEP).any():
                break
        return size <= LAST_STEP, ahead > 0

    def _within(self, k: Array, p: Array, q: Array) -> Array:
        """Return which pixels lie within the extent and the borders."""
        reach, _ = self._extent(k)
        radius = np.sqrt(p * p + q * q)
        inside = self.pixel_inside(p, q, k)
        if radius.max(initial=0.0) <= reach.min():
            return inside
        spoke = np.nan_to_num(np.arctan2(q, p)) * (SPOKES / (2 * np.pi)) % SPOKES
        low = np.minimum(spoke.astype(int), SPOKES - 1)
        return np.asarray(inside & (radius <= np.minimum(reach[low], reach[(low + 1) % SPOKES])))

    # ------------------------------------------------------------------ map
    def distort(self, k: Array, x: Array, y: Array, z: Array) -> tuple[Array, Array]:
        """Solve for the pixel by Newton's method."""
        p, q, _ = self._solve(k, x, y, z)
        return p, q

    def in_domain(self, k: Array, x: Array, y: Array, z: Array) -> Array:
        """Return for which points Newton's method ends within the domain."""
        return self._solve(k, x, y, z)[2]

    def _project(self, params: Array, x: Array, y: Array, z: Array) -> tuple[Array, Array, Array]:
        """Solve once for both the pixel and the domain."""
        x, y = self._centred(params, x, y, z)
        p, q, valid = self._solve(params[self._own :], x, y, z)
        return *self._pixels(params, p, q), valid

    def derivatives(
        self, k: Array, x: Array, y: Array, z: Array, d_xyz: Array, d_k: Array, fx: float, fy: float
    ) -> tuple[Array, Array, bool]:
        """Equation (1)."""
        p, q, inside, normals = self._implicit(k, x, y, z, d_xyz, fx, fy)
        for i, normal in enumerate(normals):
            self.ray_rows(k, p, q, normal, d_k[:, :, i])
        return p, q, inside

    def _implicit(
        self, k: Array, x: Array, y: Array, z: Array, d_xyz: Array, fx: float, fy: float
    ) -> tuple[Array, Array, bool, tuple[Array, Array]]:
        """Return p, q, whether all are inside, and the vectors (3, V, N) whose products with dX/dk are d(fx p, fy
        q)/dk.
        """
        p, q, valid = self._solve(k, x, y, z)
        ray, a, b = self.ray(k, p, q)
        length = np.sqrt((ray * ray).sum(0) / (x * x + y * y + z * z))
        inverse = 1.0 / _triple(ray, a, b)
        normals = _cross(b, ray) * (-fx * inverse), _cross(ray, a) * (-fy * inverse)
        for i, normal in enumerate(normals):
            for j in range(3):
                np.multiply(normal[j], -length, out=d_xyz[:, j, i])
        return p, q, bool(valid.all()), normals

    def rays_with_derivatives(self, params: Array, uv: Array) -> tuple[Array, Array, Array, Array]:
        """The rays of pixels, and how they change with pixel and parameters, without a projection.

        Parameters
        ----------
        params : (P,) array
        uv : (N, 2) array, px

        Returns
        -------
        ray : (N, 3) array, of unit length
        by_uv : (N, 3, 2) array, by_params : (N, 3, P) array
            Normal to the ray.
        valid : (N,) bool array
        """
        fx, fy, cx, cy = params[:4].tolist()
        skew = float(params[4]) if self.has_skew else 0.0
        q = (uv[:, 1] - cy) / fy
        p = (uv[:, 0] - cx - skew * q) / fx
        k, zero = params[self._own :], np.zeros_like(p)
        x, a, b = self.ray(k, p, q)
        valid = self._within(k, p, q) & (_triple(x, a, b) > 0)
        # p and q by fx, fy, cx, cy and the skew
        across = [-p / fx, skew * q / (fx * fy), zero - 1 / fx, zero + skew / (fx * fy), -q / fx]
        down = [zero, -q / fy, zero, zero - 1 / fy, zero]
        rows = np.empty((3, len(params), len(p)))
        for i in range(self._own):
            rows[:, i] = a * across[i] + b * down[i]
        axes = np.broadcast_to(np.eye(3)[:, :, None], (3, 3, len(p)))
        three = (3, len(p))
        at = np.broadcast_to(p, three), np.broadcast_to(q, three)
        self.ray_rows(k, at[0], at[1], axes, rows[:, self._own :])
        by_uv = np.stack([a / fx, (b - a * (skew / fx)) / fy], 1)
        length = np.sqrt((x * x).sum(0))
        ray = x / length
        out = []
        for block in (by_uv, rows):
            along = np.einsum("in,ikn->kn", ray, block)
            out.append(((block - ray[:, None] * along) / length).transpose(2, 0, 1))
        return ray.T, out[0], out[1], valid

    def undistort(self, k: Array, mx: Array, my: Array) -> tuple[Array, Array, Array, Array]:
        """The ray of the pixel, by definition."""
        ray, a, b = self.ray(k, mx, my)
        valid = self._within(k, mx, my) & (_triple(ray, a, b) > 0)
        x, y, z = ray
        return x, y, z, valid


def _cross(a: Array, b: Array) -> Array:
    out = np.empty_like(a)
    for i, (j, k) in enumerate(((1, 2), (2, 0), (0, 1))):
        np.multiply(a[j], b[k], out=out[i])
        out[i] -= a[k] * b[j]
    return out


def _dot(a: Array, b: Array) -> Array:
    out = a[0] * b[0]
    out += a[1] * b[1]
    out += a[2] * b[2]
    return np.asarray(out)


def _triple(x: Array, a: Array, b: Array) -> Array:
    """x · (a x b)."""
    return _dot(x, _cross(a, b))


def _newton_step(state: Array, target: Array) -> tuple[Array, Array, Array]:
    """Solve X + a dp + b dq = λ target for dp, dq; also return target · (a x b), which has the sign of D."""
    x, a, b = state
    across, along = _cross(b, target), _cross(target, a)
    d = _dot(a, across)
    inverse = -1.0 / d
    return _dot(x, across) * inverse, _dot(x, along) * inverse, d
