"""A radial lens without a fixed formula: a smooth, increasing spline whose shape the data determine.

R. Hartley, S. B. Kang, Parameter-free radial distortion correction with centre of distortion estimation,
ICCV (2005) and PAMI 29 (2007): the radius is any monotone function, the centre of distortion is estimated.
Here the angle of a ray is a cubic spline over the image radius R (in focal lengths), in addition to what a
pinhole camera has:

    θ(R) = atan R + R S(R / reach),  S even, S(0) = 0                                                    (1)

S is a uniform cubic B-spline of n intervals over [0, 1] with c(-1) = c(1), c(0) = -c(1) / 2, so that the
curve is smooth at the centre and the focal length is its slope there. `reach` is held fixed: it says how far
the data go. Beyond it, and where θ no longer grows, is outside. The centre is (cx, cy); with centre=free the
principal point may lie elsewhere (see `mapped`).
"""

from __future__ import annotations

import numpy as np

from camcal.model.lenses.base import Lens, example_list
from camcal.model.lenses.bspline import locate, refined, slopes, weights
from camcal.model.lenses.curve import cached
from camcal.model.lenses.forms import Values
from camcal.model.lenses.options import choice, count_option, no_options
from camcal.model.lenses.parameters import Parameter
from camcal.model.lenses.radial import InverseRadialLens
from camcal.model.lenses.start import image_radii

Array = np.ndarray

#: intervals by default, which leave 0.2771 px where kb4 leaves 0.2770 on its own lens (docs/lenses.md), and at most: a
#: board seldom has more than 40 rows of points along a radius
INTERVALS, MOST = 8, 40
#: the curve reaches this much farther than the data, so that the rim does not move over its end in a fit
MARGIN = 1.1
#: weight of a third difference of 1 px: one of 100 px counts like a residual of 1 px
SMOOTH = 0.01
#: places per interval at which the curve is looked at for a fold, and how often 16 times closer about the one that is
#: found: to 16⁻⁵ of an interval, 1e-6
SAMPLES, CLOSER = 16, 4
#: focal lengths; the half diagonal of a picture is 0.005 of them with the longest telescope lens of the benchmarks
LEAST_REACH = 1e-4


class RadialProfile(InverseRadialLens):
    """`radial-profile:n,centre=free|principal`: n intervals."""

    default_fixed = ("reach",)
    shaped_by_data = True

    def __init__(self, name: str, intervals: int, free_centre: bool, skew: bool = False):
        self.intervals = intervals
        own = [Parameter("reach", "distortion", neutral=2.0, lower=LEAST_REACH)]
        own += [Parameter(f"s{i + 1}", "distortion") for i in range(intervals + 1)]
        super().__init__(name, own, skew, free_centre)

    @classmethod
    def parse(cls, name: str, plain: list[str], named: dict[str, str], skew: bool) -> RadialProfile:
        """Parse the options; by default 8 intervals about the principal point."""
        no_options(name, plain[1:], named, ("centre",))
        intervals = count_option(name, plain, INTERVALS, 2, MOST)
        centre = choice(name, named, "centre", ("principal", "free"))
        spec = f"{name}:{intervals}" if plain or centre == "free" else name
        spec += ",centre=free" * (centre == "free")
        return cls(spec, intervals, centre == "free", skew)

    def smaller(self) -> tuple[str, ...]:
        """Models about the principal point whose interval count divides this one's, the largest first."""
        centre = ",centre=free" * self.free_centre
        fewer = [n for n in range(self.intervals // 2, 1, -1) if self.intervals % n == 0]
        own = [f"radial-profile:{self.intervals}"] * self.free_centre
        return (*own, *(f"radial-profile:{n}{centre}" for n in fewer))

    def from_coarser(self, inner: Lens, params: Array) -> Array | None:
        """Refine a spline to a multiple of its intervals, exactly; the centre may become free."""
        if not isinstance(inner, RadialProfile) or inner.free_centre > self.free_centre:
            return None
        times, rest = divmod(self.intervals, inner.intervals)
        if rest or inner.has_skew > self.has_skew:
            return None
        out = self.from_values(dict(zip(inner.names, params.tolist(), strict=True)))
        out[self._own + 1 :] = refined(inner._control(params[inner._own :]), times)[2:]
        return out

    def shapes(self, rays: Array, uv: Array, image_size: tuple[int, int] | None) -> list[Values]:
        """`reach` from the data; the curve by least squares from the angles at the radii."""
        radius, theta = image_radii(rays, uv, image_size)
        reach = MARGIN * float(radius.max())
        used = np.isfinite(theta)
        basis = self._basis(radius[None, used] / reach)[0] * radius[used]
        known = theta[used] - np.arctan(radius[used])
        # a little of the second differences keeps intervals without data in line with their neighbours
        smooth = 1e-3 * np.sqrt(used.sum()) * np.diff(np.eye(self.intervals + 1), 2, axis=0)
        lines = np.concatenate([basis.T, smooth])
        values = np.linalg.lstsq(lines, np.r_[known, np.zeros(len(smooth))], rcond=None)[0]
        return [{"reach": reach} | {f"s{i + 1}": float(v) for i, v in enumerate(values)}]

    def examples(self) -> list[tuple[Array, tuple[int, int]]]:
        """A lens of 190 degrees, and a mild one."""
        skew = [0.8] if self.has_skew else []
        centre = [[0.01, -0.02], [-0.02, 0.01]] if self.free_centre else [[], []]
        at = np.arange(1, self.intervals + 2) / self.intervals
        return example_list(
            ([338.0, 339.0, 517.0, 392.0, *skew, *centre[0], 2.2, *0.16 * at**2], (1032, 778)),
            ([533.0, 534.0, 331.0, 234.0, *skew, *centre[1], 0.85, *-0.1 * at**2], (640, 480)),
        )

    def prior(self, params: Array) -> tuple[Array, Array] | None:
        """`SMOOTH` · fx times every third difference of the coefficients, px; determines coefficients without
        data.
        """
        differences = SMOOTH * np.diff(np.eye(self.intervals + 1), 3, axis=0)
        residuals = differences @ params[self._own + 1 :]
        jacobian = np.zeros((len(differences), self.size))
        jacobian[:, 0] = residuals
        jacobian[:, self._own + 1 :] = params[0] * differences
        return params[0] * residuals, jacobian

    # ------------------------------------------------------------------ spline
    def _control(self, k: Array) -> Array:
        """All n + 3 coefficients from reach, c1, c2, ..."""
        c = k[1:]
        return np.concatenate([[c[0], -0.5 * c[0]], c])

    def _basis(self, t: Array) -> Array:
        """dS/dc of c1, c2, ... (V, n + 1, N) at t (V, N), t = R / reach."""
        cell, f = locate(t * self.intervals, self.intervals)
        full = np.zeros((len(t), self.intervals + 3, t.shape[1]))
        for m, w in enumerate(weights(f)):
            np.put_along_axis(full, (cell + m)[:, None], w[:, None], 1)
        full[:, 2] += full[:, 0] - 0.5 * full[:, 1]
        return full[:, 2:]

    def _spline(self, k: Array, t: Array) -> tuple[Array, Array]:
        """S and dS/dt."""
        control = self._control(k)
        cell, f = locate(t * self.intervals, self.intervals)
        value, slope = np.zeros_like(f), np.zeros_like(f)
        for m, (w, d) in enumerate(zip(weights(f), slopes(f), strict=True)):
            c = control[cell + m]
            value += w * c
            slope += d * c
        return value, slope * self.intervals

    # ------------------------------------------------------------------ curve
    def ray_angle(self, k: Array, radius: Array) -> tuple[Array, Array]:
        """Equation (1)."""
        t = radius / float(k[0])
        value, slope = self._spline(k, t)
        return np.arctan(radius) + radius * value, 1 / (1 + radius * radius) + value + t * slope

    def ray_angle_rows(self, k: Array, radius: Array, d_k: Array) -> None:
        """Derivatives of (1); increasing `reach` evaluates the spline nearer to the centre."""
        t = radius / float(k[0])
        _, slope = self._spline(k, t)
        np.multiply(slope, -t * t, out=d_k[:, 0])
        np.multiply(self._basis(t), radius[:, None], out=d_k[:, 1:])

    @cached
    def reach(self, k: Array) -> float:
        """`reach`, or the radius where the curve turns or reaches π if that is smaller, found by repeated
        subdivision.
        """
        low, high = 0.0, float(k[0])
        for places in (SAMPLES * self.intervals, *[SAMPLES] * CLOSER):
            radius = np.linspace(low, high, places + 1)
            theta, slope = self.ray_angle(k, radius)
            bad = np.flatnonzero(~(slope > 0) | ~(theta < np.pi))
            if not len(bad):
                return high
            low, high = float(radius[max(bad[0] - 1, 0)]), float(radius[bad[0]])
        return low
