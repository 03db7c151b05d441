"""Base class of lens models: a camera matrix applied to a map from rays to distorted normalised coordinates.

    (mx, my) = distort(x, y, z),  u = fx mx + skew my + cx,  v = fy my + cy                              (1)

With a free distortion centre (xc, yc), in units of the focal length, the map acts about that centre:

    (mx, my) = (xc, yc) + distort(x - xc z, y - yc z, z)                                                 (2)

so that the principal point (cx, cy) and the distortion centre (cx + fx xc + skew yc, cy + fy yc) are apart, as
in Brown (1966) and in Hartley & Kang (2005).

A subclass states the map, its derivatives, its inverse and its domain on coordinates as separate arrays of one
shape (x, y, z), the layout in which the refinement keeps them. The public methods take (..., 3) and (..., 2)
arrays and give NaN outside the domain. A lens never changes: what a model derives from its coefficients (limits,
tables) is kept by `curve.cached`, outside it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import Any

import numpy as np

from camcal.model.lenses.forms import LocalRows, OpenCVForm, Reading, Values
from camcal.model.lenses.parameters import MATRIX, Parameters, each

Array = np.ndarray

#: points worked on at a time: a few dozen temporary arrays of 64 kB stay in a cache of 1 to 2 MB, and the cost
#: of calling numpy (1 µs) is small beside 8192 points (8 µs an operation)
BLOCK = 8192
#: and with derivatives by a dozen parameters, whose rows of 32 kB take half a megabyte
JACOBIANS = 2048


class Lens(Parameters, ABC):
    """A camera model. Lenses of the same type, spec and skew are equal.

    Attributes
    ----------
    default_fixed : tuple of str
        Parameters that the model's gauge holds where they start, unless the user frees them.
    turns : tuple of str
        Those of them that turn the picture, as a pose does; where there is no pose they are estimated.
    shaped_by_data : bool
        Whether the model must see rays and pixels before it can hold any camera well (`shapes`).
    several_minima : bool
        Whether cameras that lie far apart can both fit nearly as well as can be.
    neutral_curve : str
        What the lens without distortion does: `perspective` (R = tan θ) or `equidistant` (R = θ).
    local : int
        So many of the last coefficients of the map are felt by few points each (`linearise_locally`).
    """

    default_fixed: tuple[str, ...] = ()
    turns: tuple[str, ...] = ()
    shaped_by_data: bool = False
    several_minima: bool = False
    neutral_curve: str = "perspective"
    local: int = 0

    @property
    def stackable(self) -> bool:
        """Whether `linearise` takes parameters (P, V, 1) that differ from view to view, for many cameras at once."""
        return False

    def __repr__(self) -> str:
        return f"<lens {self.name}{' with skew' if self.has_skew else ''}>"

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and (self.name, self.has_skew) == (other.name, other.has_skew)

    def __hash__(self) -> int:
        return hash((type(self), self.name, self.has_skew))

    # ------------------------------------------------------------------ what a model states
    @classmethod
    @abstractmethod
    def parse(cls, name: str, plain: list[str], named: dict[str, str], skew: bool) -> Lens:
        """Make the model from the parts of its spec; UsageError for an unknown option."""

    @abstractmethod
    def distort(self, k: Array, x: Array, y: Array, z: Array) -> tuple[Array, Array]:
        """The map (mx, my) without a domain check; `k` holds the distortion coefficients alone."""

    @abstractmethod
    def derivatives(
        self, k: Array, x: Array, y: Array, z: Array, d_xyz: Array, d_k: Array, fx: float, fy: float
    ) -> tuple[Array, Array, bool | Array]:
        """The map and its derivatives times the focal lengths: the inner kernel of the refinement.

        Parameters
        ----------
        x, y, z : (V, N) arrays
        d_xyz : (V, 3, 2, N) array, filled with d(fx mx, fy my) / d(x, y, z)
        d_k : (V, Q, 2, N) array, filled with d(fx mx, fy my) / dk

        Returns
        -------
        mx, my : (V, N) arrays
        inside : bool
            False where a point is outside the domain; the values are then not used. Of coefficients (Q, V, 1), by
            view (V, 1).
        """

    @abstractmethod
    def undistort(self, k: Array, mx: Array, my: Array) -> tuple[Array, Array, Array, Array]:
        """The inverse: a ray (x, y, z) of any length, and which points have an inverse."""

    @abstractmethod
    def in_domain(self, k: Array, x: Array, y: Array, z: Array) -> Array:
        """Return which points lie in the domain: visible, and before the first fold or pole."""

    # ------------------------------------------------------------------ what a model may override

    def examples(self) -> list[tuple[Array, tuple[int, int]]]:
        """Realistic cameras (params, image_size) that every contract test runs on."""
        return [(self.pinhole(500.0, 505.0, 320.0, 238.0), (640, 480))]

    def shapes(self, rays: Array, uv: Array, image_size: tuple[int, int] | None) -> list[Values]:
        """Starting values of the distortion parameters for fitting the model to rays and pixels.

        Parameters
        ----------
        rays : (N, 3) array of unit length
        uv : (N, 2) array, px

        Returns
        -------
        list of mappings, name -> value, the rest neutral; the camera matrix of each is found linearly.
        """
        return [{}]

    def opencv(self, params: Array) -> OpenCVForm | None:
        """The same camera for cv2, or None where cv2 has no such model."""
        return None

    def prior(self, params: Array) -> tuple[Array, Array] | None:
        """Residuals (K,) and Jacobian (K, P) of the model's own regularisation, px; None if it has none."""
        return None

    def linearise_locally(
        self, params: Array, xyz: Array, uv: Array, d_xyz: Array, d_dense: Array
    ) -> LocalRows | None:
        """As `linearise`, for models with many coefficients of which each point depends on a few; see `local`."""
        raise NotImplementedError

    # ------------------------------------------------------------------ which models contain which
    def smaller(self) -> tuple[str, ...]:
        """Specs of the next smaller models of the same family, the largest first."""
        return ()

    def terms(self) -> dict[str, str]:
        """The terms of `Reading` that the model has: term -> parameter name.

        By default terms of its own, which no other model has.
        """
        return {f"{type(self).__name__}.{n}": n for n in self.names if n not in MATRIX}

    def readings(self, values: Values) -> Iterator[Reading]:
        """A camera of this model, given by name, in shared terms: every form in which another model may represent
        it.
        """
        of = {t: n for t, n in self.terms().items() if values[n] != self.neutral[self.index(n)]}
        matrix = {n: values[n] for n in MATRIX if values.get(n, 0.0) != 0.0}
        yield Reading(matrix | {t: values[n] for t, n in of.items()}, self.neutral_curve)

    def from_coarser(self, inner: Lens, params: Array) -> Array | None:
        """For models that are `shaped_by_data`: the exact equivalent of a camera of the same family with fewer
        intervals.
        """
        return None

    # ------------------------------------------------------------------ equations (1) and (2)
    def _centred(self, params: Array, x: Array, y: Array, z: Array) -> tuple[Array, Array]:
        if not self.free_centre:
            return x, y
        xc, yc = params[self._bend : self._own].tolist()
        return x - xc * z, y - yc * z

    def _pixels(self, params: Array, mx: Array, my: Array) -> tuple[Array, Array]:
        if self.free_centre:
            mx, my = mx + params[self._bend], my + params[self._bend + 1]
        u = params[0] * mx + params[2]
        if self.has_skew:
            u += params[4] * my
        return u, params[1] * my + params[3]

    def forward(self, params: Array, x: Array, y: Array, z: Array) -> tuple[Array, Array]:
        """Project without a domain check: (u, v) of points whose coordinates are separate arrays."""
        x, y = self._centred(params, x, y, z)
        return self._pixels(params, *self.distort(params[self._own :], x, y, z))

    def inside(self, params: Array, x: Array, y: Array, z: Array) -> Array:
        """Return which points lie in the domain."""
        x, y = self._centred(params, x, y, z)
        return self.in_domain(params[self._own :], x, y, z)

    def backward(self, params: Array, u: Array, v: Array) -> tuple[Array, Array, Array, Array]:
        """Unproject: (x, y, z) of a ray of any length, and the mask of pixels inside the domain."""
        my = (v - params[3]) / params[1]
        mx = (u - params[2] - (params[4] * my if self.has_skew else 0.0)) / params[0]
        if not self.free_centre:
            return self.undistort(params[self._own :], mx, my)
        xc, yc = params[self._bend : self._own].tolist()
        x, y, z, valid = self.undistort(params[self._own :], mx - xc, my - yc)
        return x + xc * z, y + yc * z, z, valid

    def linearise(
        self, params: Array, x: Array, y: Array, z: Array, uv: Array, d_xyz: Array, d_params: Array
    ) -> bool | Array:
        """Project with derivatives into preallocated arrays.

        Parameters
        ----------
        params : (P,) array, or (P, V, 1) where the lens is `stackable`
        x, y, z : (V, N) arrays
        uv : (V, 2, N) array, filled with the projections
        d_xyz : (V, 3, 2, N) array, filled with d(u, v) / d(x, y, z)
        d_params : (V, P, 2, N) array, filled with d(u, v) / d params

        Returns
        -------
        bool
            False where a point has left the domain or a parameter its bounds: the values are then not to be used.
            By view, (V, 1), of parameters (P, V, 1).
        """
        fx, fy = each(params[:2])
        x, y = self._centred(params, x, y, z)
        rows, k = d_params[:, self._own :], params[self._own :]
        mixed = self.has_skew or self.free_centre
        mx, my, inside = self.derivatives(k, x, y, z, d_xyz, rows, *((1.0, 1.0) if mixed else (fx, fy)))
        if mixed:
            mx, my = self._mix(params, mx, my, z, d_xyz, d_params[:, self._bend :])
        self._pixel_rows(params, mx, my, uv, d_params)
        return inside & self.within_bounds(params)

    def _pixel_rows(self, params: Array, mx: Array, my: Array, uv: Array, d_params: Array) -> None:
        """Equation (1) and its derivatives with respect to the camera matrix."""
        np.multiply(mx, params[0], out=uv[:, 0])
        uv[:, 0] += params[2]
        np.multiply(my, params[1], out=uv[:, 1])
        uv[:, 1] += params[3]
        d_params[:, : self._bend] = 0.0
        d_params[:, 0, 0], d_params[:, 1, 1] = mx, my
        d_params[:, 2, 0] = d_params[:, 3, 1] = 1.0
        if self.has_skew:
            uv[:, 0] += params[4] * my
            d_params[:, 4, 0] = my

    def _mix(
        self, params: Array, mx: Array, my: Array, z: Array, d_xyz: Array, rows: Array
    ) -> tuple[Array, Array]:
        """Apply the distortion centre and the skew to derivatives of the map alone; return (mx, my) of (2)."""
        if self.free_centre:
            xc, yc = params[self._bend : self._own].tolist()
            z_ = z[:, None]
            for i in range(2):  # d/dxc: the centre moves, and the map is read elsewhere
                np.multiply(d_xyz[:, i], -z_, out=rows[:, i])
                rows[:, i, i] += 1.0
            d_xyz[:, 2] -= xc * d_xyz[:, 0] + yc * d_xyz[:, 1]
            mx, my = mx + xc, my + yc
        for block in (rows, d_xyz):
            self._to_pixels(params, block)
        return mx, my

    def _to_pixels(self, params: Array, block: Array) -> None:
        """Convert derivatives (V, ., 2, N) of (mx, my) into derivatives of (u, v), in place."""
        block[:, :, 0] *= params[0]
        if self.has_skew:
            block[:, :, 0] += params[4] * block[:, :, 1]
        block[:, :, 1] *= params[1]

    # ------------------------------------------------------------------ for everybody
    def project(self, params: Array, xyz: Array) -> tuple[Array, Array]:
        """Project points of the camera's frame.

        Parameters
        ----------
        params : (P,) array
        xyz : (..., 3) array, any unit

        Returns
        -------
        uv : (..., 2) array, px; NaN outside the domain
        valid : (...) bool array
        """

        def project(x: Array, y: Array, z: Array) -> tuple[tuple[Array, ...], Array]:
            u, v, found = self._project(params, x, y, z)
            return (u, v), found & np.isfinite(u) & np.isfinite(v)

        return _in_blocks(project, np.asarray(xyz, float), 2)

    def _project(self, params: Array, x: Array, y: Array, z: Array) -> tuple[Array, Array, Array]:
        """`forward` and `inside`; overridden by models that obtain both from one computation."""
        return *self.forward(params, x, y, z), self.inside(params, x, y, z)

    def unproject(self, params: Array, uv: Array) -> tuple[Array, Array]:
        """Return the rays of pixels.

        Parameters
        ----------
        params : (P,) array
        uv : (..., 2) array, px

        Returns
        -------
        ray : (..., 3) array of unit length in the camera's frame; NaN outside the domain
        valid : (...) bool array
        """

        def unproject(u: Array, v: Array) -> tuple[tuple[Array, ...], Array]:
            x, y, z, found = self.backward(params, u, v)
            scale = x * x
            scale += y * y
            scale += z * z
            np.sqrt(scale, out=scale)
            np.divide(1.0, scale, out=scale)
            return (x * scale, y * scale, z * scale), found

        return _in_blocks(unproject, np.asarray(uv, float), 3)

    def jacobians(self, params: Array, xyz: Array) -> tuple[Array, Array, Array, Array]:
        """Project points (N, 3) with derivatives.

        Returns
        -------
        uv : (N, 2) array, px
        d_xyz : (N, 2, 3) array, px per unit
        d_params : (N, 2, P) array
        valid : (N,) bool array
        """
        xyz = np.asarray(xyz, float)
        n = len(xyz)
        uv, d_xyz, d_params = np.empty((n, 2)), np.empty((n, 2, 3)), np.empty((n, 2, self.size))
        valid = np.empty(n, bool)
        for begin in range(0, n, JACOBIANS):
            rows = slice(begin, begin + JACOBIANS)
            x, y, z = (np.ascontiguousarray(c)[None] for c in xyz[rows].T)
            block = np.empty((1, 4 + self.size, 2, x.shape[1]))
            with np.errstate(all="ignore"):
                inside = self.inside(params, x, y, z)[0]
                self.linearise(params, x, y, z, block[:, 0], block[:, 1:4], block[:, 4:])
                inside &= np.isfinite(block[0, 0]).all(0)
            found = block[0].transpose(2, 1, 0)
            if not inside.all():
                found[~inside] = np.nan
            uv[rows], d_xyz[rows], d_params[rows] = found[:, :, 0], found[:, :, 1:4], found[:, :, 4:]
            valid[rows] = inside
        return uv, d_xyz, d_params, valid

    def limit_angle(self, params: Array) -> float:
        """The half-angle of the domain about the optical axis, rad: up to it there is no fold and no pole.

        By asking `inside` along a fan of directions; models that know it better override this.
        """
        low, high = 0.0, np.pi
        for steps in (361, 101, 101, 101):
            angles = np.linspace(low, high, steps)
            with np.errstate(all="ignore"):
                leaves = ~self._ring_inside(params, angles)
            first = int(leaves.argmax()) if leaves.any() else steps - 1
            low, high = angles[max(first - 1, 0)], angles[first]
        return float(low)

    def _ring_inside(self, params: Array, angles: Array) -> Array:
        """Return whether all directions at the angles (A,) from the axis are inside, (A,) bool."""
        turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
        radius, z = np.sin(angles)[:, None], np.repeat(np.cos(angles)[:, None], len(turn), 1)
        return np.asarray(self.inside(params, radius * np.cos(turn), radius * np.sin(turn), z).all(1))


def _in_blocks(function: Any, points: Array, width: int) -> tuple[Array, Array]:
    """Apply a columnwise function to points (..., C) in blocks: (..., width) with NaN where invalid, and the mask."""
    flat = points.reshape(-1, points.shape[-1])
    out, valid = np.empty((len(flat), width)), np.empty(len(flat), bool)
    with np.errstate(all="ignore"):
        for begin in range(0, len(flat), BLOCK):
            rows = slice(begin, begin + BLOCK)
            columns, found = function(*np.ascontiguousarray(flat[rows].T))
            for i, column in enumerate(columns):
                out[rows, i] = column
            valid[rows] = found
            if not found.all():
                out[rows][~found] = np.nan
    return out.reshape(*points.shape[:-1], width), valid.reshape(points.shape[:-1])


def example_list(*cameras: Any) -> list[tuple[Array, tuple[int, int]]]:
    """Collect (params, image_size) pairs as float arrays."""
    return [(np.array(params, float), size) for params, size in cameras]
