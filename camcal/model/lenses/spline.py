"""A generic central camera: the ray is a B-spline surface over the image.

T. Schöps, V. Larsson, M. Pollefeys, T. Sattler, Why having 10,000 parameters in your camera model is better
than twelve, CVPR (2020), section 3; mrcal's splined stereographic models. In stereographic coordinates, which
hold all directions but the one straight behind,

    w = (X, Y) · 2 / (|X| + Z),  X ~ (w, 1 - |w|² / 4)                                                   (1)

the ray of a pixel (p, q), less the camera matrix, is a pinhole camera's and a bicubic tensor-product spline S
with C x R control points over the rectangle left to right, top to bottom:

    w(p, q) = (p, q) · 2 / (1 + sqrt(1 + p² + q²)) + S(p, q)                                             (2)

Gauge: fx, fy, cx, cy, skew and the rectangle only say where the control points are; they are held. A turn of
the camera moves all control points alike and is the pose's.

Regularisation (`prior`), as residuals in px that are added to those of the points: `smooth` · fx times every
third difference of neighbouring control points along the rows and the columns, which leaves quadratic
surfaces alone and settles control points that few observations reach; and three that fix the turn: fx times
the mean of S and its mean rotation.
"""

from __future__ import annotations

import re

import numpy as np

from camcal.errors import UsageError
from camcal.model.lenses.base import Lens, example_list
from camcal.model.lenses.bspline import locate, refined, slopes, weights
from camcal.model.lenses.forms import LocalRows, Values
from camcal.model.lenses.inverse import InverseLens
from camcal.model.lenses.options import no_options
from camcal.model.lenses.parameters import Parameter
from camcal.model.lenses.start import rough_pinhole

Array = np.ndarray

#: weight at least for the direct fit, which has no points in some cells and would be singular without
LEAST_SMOOTH = 1e-3
SMOOTH = 0.01  #: weight of a third difference of 1 px: one of 100 px counts like a residual of 1 px
#: the rectangle is larger than the image by this part on each side, so that points at the rim feel complete cells
MARGIN = 0.05
#: control points in a direction: a cubic needs 4; 40 x 40 are 3200 coefficients
LEAST, MOST = 4, 40
RECTANGLE = ("left", "top", "right", "bottom")
_NEUTRAL = (-1.5, -1.2, 1.5, 1.2)


class Spline(InverseLens):
    """`spline:CxR,smooth=w`: C x R control points."""

    shaped_by_data = True

    def __init__(self, columns: int, rows: int, smooth: float = SMOOTH, skew: bool = False):
        self.columns, self.rows, self.smooth = columns, rows, smooth
        own = [Parameter(n, "distortion", v) for n, v in zip(RECTANGLE, _NEUTRAL, strict=True)]
        grid = [(i, j) for j in range(rows) for i in range(columns)]
        own += [Parameter(f"{axis}{i}_{j}", "distortion") for axis in "xy" for i, j in grid]
        name = f"spline:{columns}x{rows}" + (f",smooth={smooth:g}" if smooth != SMOOTH else "")
        super().__init__(name, own, skew)
        self.default_fixed = self.names[: self._own + 4]
        self.local = 2 * columns * rows

    @classmethod
    def parse(cls, name: str, plain: list[str], named: dict[str, str], skew: bool) -> Spline:
        """Parse the options; by default 8 x 6 control points."""
        no_options(name, plain[1:], named, ("smooth",))
        found = re.fullmatch(r"(\d+)x(\d+)", plain[0] if plain else "8x6")
        counts = [int(n) for n in found.groups()] if found else [0]
        if not all(LEAST <= n <= MOST for n in counts):
            raise UsageError(
                f"model '{name}' has no option '{plain[0]}'; columns x rows of control points, "
                f"{LEAST} to {MOST} each, are needed.",
                "Try: --model spline:8x6",
            )
        try:
            smooth = float(named.get("smooth", SMOOTH))
        except ValueError:
            smooth = -1.0
        if not 0 <= smooth < np.inf:
            raise UsageError(f"model '{name}': smooth={named['smooth']} is not a number of at least 0.")
        return cls(counts[0], counts[1], smooth, skew)

    def smaller(self) -> tuple[str, ...]:
        """Models whose interval counts divide this one's in each direction, the largest first."""
        columns, rows = self.columns - 3, self.rows - 3
        smooth = self.name.partition(",")[2]
        counts = [(c, r) for c in _divisors(columns) for r in _divisors(rows) if (c, r) != (columns, rows)]
        sizes = sorted(counts, key=lambda n: -(n[0] + 3) * (n[1] + 3))
        return tuple(f"spline:{c + 3}x{r + 3}" + f",{smooth}" * bool(smooth) for c, r in sizes)

    def from_coarser(self, inner: Lens, params: Array) -> Array | None:
        """Refine a spline to multiples of its intervals, exactly."""
        if not isinstance(inner, Spline):
            return None
        (across, rest), (down, more) = (
            divmod(n - 3, m - 3) for n, m in ((self.columns, inner.columns), (self.rows, inner.rows))
        )
        if rest or more or inner.has_skew > self.has_skew:
            return None
        out = self.from_values(dict(zip(inner.names[: inner._own + 4], params.tolist(), strict=False)))
        for at, surface in enumerate(params[inner._own + 4 :].reshape(2, inner.rows, inner.columns)):
            fine = refined(refined(surface, down).T, across).T
            begin = self._own + 4 + at * self.rows * self.columns
            out[begin : begin + fine.size] = fine.ravel()
        return out

    def examples(self) -> list[tuple[Array, tuple[int, int]]]:
        """A barrel-shaped lens with a ripple in it, and a fisheye lens of 160 degrees."""
        skew = [0.8] if self.has_skew else []
        out = []
        for f, bend, rectangle, centre, size in (
            (533.0, -0.06, (-0.71, -0.5, 0.65, 0.55), (341.0, 234.0), (640, 480)),
            (560.0, 0.12, (-1.23, -0.8, 1.3, 0.85), (630.0, 390.0), (1280, 800)),
        ):
            left, top, right, bottom = rectangle
            gx, gy = np.meshgrid(np.linspace(left, right, self.columns), np.linspace(top, bottom, self.rows))
            s = gx * gx + gy * gy
            x, y = bend * gx * s + 0.003 * np.sin(3 * gy), bend * gy * s - 0.002 * np.cos(4 * gx)
            out.append(([f, f + 1, *centre, *skew, *rectangle, *x.ravel(), *y.ravel()], size))
        return example_list(*out)

    # ------------------------------------------------------------------ start
    def shapes(self, rays: Array, uv: Array, image_size: tuple[int, int] | None) -> list[Values]:
        """A nominal camera matrix, the rectangle of the image, and the control points by linear least squares."""
        f, centre = rough_pinhole(rays, uv)
        low, high = uv.min(0), uv.max(0)
        if image_size is not None:
            low, high = np.minimum(low, 0), np.maximum(high, np.array(image_size) - 1.0)
        low, high = low - MARGIN * (high - low), high + MARGIN * (high - low)
        params = self.pinhole(abs(f), abs(f), *centre.tolist())
        params[self._own : self._own + 4] = np.r_[(low - centre) / abs(f), (high - centre) / abs(f)]
        p, q = ((uv - centre) / abs(f)).T
        k = params[self._own :]
        columns, values = self._basis(k, p, q)
        basis = np.zeros((len(p), self.columns * self.rows))
        np.put_along_axis(basis, columns.T, values.T, 1)
        w = 2 * rays[:, :2] / (np.linalg.norm(rays, axis=1) + rays[:, 2])[:, None]
        base = np.stack(_stereographic(p, q)[:2], 1)
        smooth = max(self.smooth, LEAST_SMOOTH) * _third_differences(self.columns, self.rows)
        lines = np.concatenate([basis, smooth])
        known = np.concatenate([w - base, np.zeros((len(smooth), 2))])
        params[self._own + 4 :] = np.linalg.lstsq(lines, known, rcond=None)[0].T.ravel()
        return [dict(zip(self.names, params.tolist(), strict=True))]

    def prior(self, params: Array) -> tuple[Array, Array] | None:
        """Third differences and the rotation; see the module's docstring."""
        fx, count = float(params[0]), self.columns * self.rows
        gx, gy = (g.ravel() for g in np.meshgrid(np.arange(self.columns), np.arange(self.rows)))
        gx, gy = gx - gx.mean(), gy - gy.mean()
        gx, gy = gx / np.abs(gx).max(), gy / np.abs(gy).max()
        differences = self.smooth * _third_differences(self.columns, self.rows)
        zero, one = np.zeros((len(differences), count)), np.full((1, count), 1 / count)
        matrix = np.block([
            [differences, zero],
            [zero, differences],
            [one, 0 * one],
            [0 * one, one],
            [-gy[None] / count, gx[None] / count],
        ])  # fmt: skip
        residuals = matrix @ params[self._own + 4 :]
        jacobian = np.zeros((len(matrix), self.size))
        jacobian[:, 0] = residuals
        jacobian[:, self._own + 4 :] = fx * matrix
        return fx * residuals, jacobian

    # ------------------------------------------------------------------ surface
    def _cells(self, k: Array, p: Array, q: Array) -> tuple[Array, ...]:
        left, top, right, bottom = k[:4].tolist()
        wide, high = (self.columns - 3) / (right - left), (self.rows - 3) / (bottom - top)
        i, f = locate((p - left) * wide, self.columns - 3)
        j, g = locate((q - top) * high, self.rows - 3)
        return i, f, j, g, np.asarray(wide), np.asarray(high)

    def _surface(self, k: Array, p: Array, q: Array) -> Array:
        """S, dS/dp, dS/dq: (3, 2, ...)."""
        i, f, j, g, wide, high = self._cells(k, p, q)
        control = k[4:].reshape(2, -1)
        out = np.zeros((3, 2, *np.shape(p)))
        columns = list(zip(weights(f), slopes(f), strict=True))
        for n, (wg, dg) in enumerate(zip(weights(g), slopes(g), strict=True)):
            at = (j + n) * self.columns + i
            for axis in range(2):
                # along the row first, then down the four rows
                value, slope = np.zeros(np.shape(p)), np.zeros(np.shape(p))
                for m, (wf, df) in enumerate(columns):
                    c = control[axis].take(at + m)
                    value += c * wf
                    slope += c * df
                out[0, axis] += value * wg
                out[1, axis] += slope * wg
                out[2, axis] += value * dg
        out[1] *= wide
        out[2] *= high
        return out

    def _basis(self, k: Array, p: Array, q: Array) -> tuple[Array, Array]:
        """The control points (16, ...) on which each pixel depends, row by row, and their basis functions."""
        i, f, j, g, *_ = self._cells(k, p, q)
        across, down = np.stack(weights(f)), np.stack(weights(g))
        basis = (down[:, None] * across[None]).reshape(16, *np.shape(p))
        corner = j * self.columns + i
        steps = (np.arange(4)[:, None] * self.columns + np.arange(4)).reshape(16, *(1,) * np.ndim(p))
        return corner + steps, basis

    # ------------------------------------------------------------------ InverseLens
    def farthest(self, k: Array) -> float:
        """The farthest corner of the rectangle."""
        return float(np.hypot(np.abs(k[[0, 2]]).max(), np.abs(k[[1, 3]]).max()))

    def pixel_inside(self, p: Array, q: Array, k: Array) -> Array:
        """Return which pixels lie in the rectangle."""
        left, top, right, bottom = k[:4].tolist()
        return np.asarray((p >= left) & (p <= right) & (q >= top) & (q <= bottom))

    def ray(self, k: Array, p: Array, q: Array) -> Array:
        """Equations (1) and (2)."""
        surface = self._surface(k, p, q)
        wx, wy, xp, cross, yq = _stereographic(p, q)
        w, by_p, by_q = surface
        w[0] += wx
        w[1] += wy
        by_p[0] += xp
        by_p[1] += cross
        by_q[0] += cross
        by_q[1] += yq
        out = np.empty((3, 3, *np.shape(p)))
        out[:, :2] = surface
        out[0, 2] = 1 - (w * w).sum(0) / 4
        out[1, 2] = -(w * by_p).sum(0) / 2
        out[2, 2] = -(w * by_q).sum(0) / 2
        return out

    def ray_rows(self, k: Array, p: Array, q: Array, normal: Array, rows: Array) -> None:
        """Derivatives via w: normal · dX/dw times the basis; those by the rectangle via the position in its cell."""
        along = self._rectangle_rows(k, p, q, normal, rows[:, :4])
        rows[:, 4:] = 0.0
        columns, basis = (np.moveaxis(a, 0, 1) for a in self._basis(k, p, q))  # (V, 16, N)
        for half, factor in enumerate(along):
            own = rows[:, 4 + half * self.local // 2 :]
            np.put_along_axis(own, columns, basis * factor[:, None], 1)

    def _rectangle_rows(
        self, k: Array, p: Array, q: Array, normal: Array, rows: Array
    ) -> tuple[Array, Array]:
        """Write normal · dX/d rectangle into rows (V, 4, N); normal · dX/dw (V, N) of both components of w."""
        surface = self._surface(k, p, q)
        base = _stereographic(p, q)[:2]
        x, y = (normal[i] - normal[2] * (surface[0, i] + base[i]) / 2 for i in range(2))
        left, top, right, bottom = k[:4].tolist()
        slope_p = x * surface[1, 0] + y * surface[1, 1]
        slope_q = x * surface[2, 0] + y * surface[2, 1]
        a, b = (p - left) / (right - left), (q - top) / (bottom - top)
        for row, value in enumerate((slope_p * (a - 1), slope_q * (b - 1), -slope_p * a, -slope_q * b)):
            rows[:, row] = value
        return x, y

    def linearise_locally(
        self, params: Array, xyz: Array, uv: Array, d_xyz: Array, d_dense: Array
    ) -> LocalRows | None:
        """See `Lens.linearise_locally`: a point depends on 4 x 4 control points, through both components of w."""
        k = params[self._own :]
        p, q, inside, normals = self._implicit(k, xyz[0], xyz[1], xyz[2], d_xyz, 1.0, 1.0)
        if not (inside and self.within_bounds(params)):
            return None
        factors = np.empty((1, 2, 2, p.shape[1]))  # half, (u, v)
        for i, normal in enumerate(normals):
            factors[0, :, i] = np.concatenate(
                self._rectangle_rows(k, p, q, normal, d_dense[:, self._own : self._own + 4, i])
            )
        for block in (d_xyz, d_dense[:, self._own :], factors):
            self._to_pixels(params, block)
        self._pixel_rows(params, p, q, uv, d_dense)
        columns, basis = self._basis(k, p[0], q[0])
        return LocalRows(columns.T, basis.T, factors[0])


def _stereographic(p: Array, q: Array) -> tuple[Array, ...]:
    """The stereographic (wx, wy) = 2 / (1 + sqrt(1 + p² + q²)) (p, q), then d(wx)/dp, d(wx)/dq = d(wy)/dp,
    d(wy)/dq.
    """
    n = np.sqrt(1 + p * p + q * q)
    g = 2 / (1 + n)
    h = -2 / (n * (1 + n) ** 2)
    return p * g, q * g, g + h * p * p, h * p * q, g + h * q * q


def _third_differences(columns: int, rows: int) -> Array:
    """Every third difference along rows and columns of a grid of C x R values, (K, C R)."""
    along, down = np.diff(np.eye(columns), 3, axis=0), np.diff(np.eye(rows), 3, axis=0)
    return np.concatenate([np.kron(np.eye(rows), along), np.kron(down, np.eye(columns))])


def _divisors(n: int) -> list[int]:
    return [d for d in range(1, n + 1) if n % d == 0]
