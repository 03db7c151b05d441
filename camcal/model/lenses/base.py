"""What a lens model is.

A model maps points of the camera's frame to pixels and back. Subclasses work on coordinates as separate
arrays of any one shape (x, y, z), because that is the layout in which the refinement keeps them in the
cache; the public methods take (..., 3) and (..., 2) arrays and mask what lies outside the domain.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from camcal.errors import UsageError

Array = np.ndarray

#: points worked on at a time: the temporaries stay in the cache, and the calls of numpy cost little beside them
BLOCK = 8192


@dataclass(frozen=True)
class Parameter:
    """A parameter of a model: `group` is focal, principal, skew or distortion."""

    name: str
    group: str
    neutral: float = 0.0
    lower: float = -np.inf
    upper: float = np.inf


@dataclass(frozen=True)
class OpenCVForm:
    """The same camera for cv2: which function takes it and the coefficients in cv2's order.

    `function` is the calibration function (`calibrateCamera`, `fisheye.calibrate`, `omnidir.calibrate`);
    `flags` are the names of its flags, `free` the names of the coefficients it would estimate with them.
    """

    function: str
    distortion: Array
    flags: tuple[str, ...] = ()
    free: tuple[str, ...] = ()
    xi: float | None = None


def pinhole_parameters(skew: bool) -> tuple[Parameter, ...]:
    """fx, fy, cx, cy and, where wanted, skew."""
    base = (
        Parameter("fx", "focal", 1.0, lower=0.0),
        Parameter("fy", "focal", 1.0, lower=0.0),
        Parameter("cx", "principal"),
        Parameter("cy", "principal"),
    )
    return (*base, Parameter("skew", "skew")) if skew else base


class Lens(ABC):
    """A camera model.

    Attributes
    ----------
    name : str
        The spec the model was made from.
    parameters : tuple of Parameter
        In the order of the parameter vector; the first four are fx, fy, cx, cy.
    has_skew : bool
    default_fixed : tuple of str
        Parameters that the model's gauge holds where they start, unless the user frees them.
    turns : tuple of str
        Those of them that turn the picture, as a pose does; where there is no pose they are estimated.
    shaped_by_data : bool
        Whether the model must see rays and pixels before it can hold any camera well (`shapes`).
    several_minima : bool
        Whether cameras that lie far apart can both fit nearly as well as can be.
    neutral_curve : str
        What the lens without distortion does: `perspective` (r = tan θ) or `equidistant` (r = θ).
    """

    name: str
    parameters: tuple[Parameter, ...]
    has_skew: bool
    default_fixed: tuple[str, ...] = ()
    turns: tuple[str, ...] = ()
    shaped_by_data: bool = False
    several_minima: bool = False
    neutral_curve: str = "perspective"

    def __init__(self, name: str, distortion: Sequence[Parameter], skew: bool = False):
        self.name = name
        self.has_skew = skew
        self.parameters = (*pinhole_parameters(skew), *distortion)
        self.names = tuple(p.name for p in self.parameters)
        self.size = len(self.parameters)
        self._bend = 5 if skew else 4  # where the distortion parameters begin

    def __repr__(self) -> str:
        return f"<lens {self.name}{' with skew' if self.has_skew else ''}>"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Lens) and (self.name, self.has_skew) == (other.name, other.has_skew)

    def __hash__(self) -> int:
        return hash((self.name, self.has_skew))

    # ------------------------------------------------------------------ what a model has to say
    @classmethod
    @abstractmethod
    def parse(cls, name: str, plain: list[str], named: dict[str, str], skew: bool) -> Lens:
        """Make the model from the parts of its spec; UsageError for an option it does not know."""

    @abstractmethod
    def forward(self, params: Array, x: Array, y: Array, z: Array) -> tuple[Array, Array]:
        """Project without looking at the domain: (u, v) of points whose coordinates are separate arrays."""

    @abstractmethod
    def inside(self, params: Array, x: Array, y: Array, z: Array) -> Array:
        """Which points lie in the domain: in view, before the first fold or pole."""

    @abstractmethod
    def linearise(
        self, params: Array, x: Array, y: Array, z: Array, uv: Array, d_xyz: Array, d_params: Array
    ) -> bool:
        """Project with derivatives into preallocated arrays: the kernel of the refinement.

        Parameters
        ----------
        x, y, z : (V, N) arrays
        uv : (V, 2, N) array, filled with the projections
        d_xyz : (V, 3, 2, N) array, filled with d(u, v) / d(x, y, z)
        d_params : (V, P, 2, N) array, filled with d(u, v) / d params

        Returns
        -------
        bool
            False where a point has left the domain: the values are then not to be used.
        """

    @abstractmethod
    def backward(self, params: Array, u: Array, v: Array) -> tuple[Array, Array, Array, Array]:
        """Unproject: (x, y, z) of a ray of any length, and the mask of pixels inside the domain."""

    def limit_angle(self, params: Array) -> float:
        """Half-angle of the domain about the optical axis, rad: up to there it has no fold and no pole.

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
        """Whether all directions at these angles (A,) from the axis are inside, (A,) bool."""
        turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
        radius, z = np.sin(angles)[:, None], np.repeat(np.cos(angles)[:, None], len(turn), 1)
        inside = self.inside(params, radius * np.cos(turn), radius * np.sin(turn), z)
        return np.asarray(inside.all(1))

    @classmethod
    def variants(cls, name: str) -> tuple[str, ...]:
        """Specs of `name` with the options that the contract tests should run besides the defaults."""
        return (name,)

    def shapes(self, rays: Array, uv: Array, image_size: tuple[int, int] | None) -> list[dict[str, float]]:
        """Values of the distortion parameters to begin from when the model is fitted to rays and pixels.

        Parameters
        ----------
        rays : (N, 3) array of unit length
        uv : (N, 2) array, px

        Returns
        -------
        list of mappings, name -> value, the rest neutral; the camera matrix of each is found linearly.
        """
        return [{}]

    def nests(self) -> tuple[str, ...]:
        """Specs of the simpler models of which this one holds every camera, the closest first."""
        return ()

    def adopt(self, other: Lens, params: Array) -> Array:
        """The parameters of this model for a camera of a model that it nests: same names, same values."""
        return self.from_values(dict(zip(other.names, params.tolist(), strict=True)))

    def opencv(self, params: Array) -> OpenCVForm | None:
        """The same camera for cv2, or None where cv2 has no such model."""
        return None

    def examples(self) -> list[tuple[Array, tuple[int, int]]]:
        """Realistic cameras (params, image_size) that every contract test runs on."""
        return [(self.pinhole(500.0, 505.0, 320.0, 238.0), (640, 480))]

    def prior(self, params: Array) -> tuple[Array, Array] | None:
        """Residuals (K,) and Jacobian (K, P) of the model's own regularisation, px; None without."""
        return None

    def normalise(self, params: Array) -> Array:
        """The same camera with its gauge fixed, where a model has one; else the parameters as they are."""
        return params

    # ------------------------------------------------------------------ parameters by name
    @property
    def neutral(self) -> Array:
        """The parameters (P,) of focal length 1 without distortion."""
        return np.array([p.neutral for p in self.parameters])

    def index(self, name: str) -> int:
        """Where a parameter stands; UsageError for an unknown name."""
        if name not in self.names:
            raise UsageError(
                f"model '{self.name}' has no parameter '{name}'.", "It has: " + ", ".join(self.names) + "."
            )
        return self.names.index(name)

    def pinhole(self, fx: float, fy: float, cx: float, cy: float, skew: float = 0.0) -> Array:
        """The parameters (P,) of a camera without distortion."""
        params = self.neutral
        params[:4] = fx, fy, cx, cy
        if self.has_skew:
            params[4] = skew
        return params

    def from_matrix(self, matrix: Array) -> Array:
        """The parameters (P,) of a camera matrix (3, 3) without distortion; a model without skew drops it."""
        k = matrix / matrix[2, 2]
        return self.pinhole(k[0, 0], k[1, 1], k[0, 2], k[1, 2], k[0, 1])

    def from_values(self, values: dict[str, float]) -> Array:
        """The parameters (P,) with those of the given names set and the rest neutral."""
        params = self.neutral
        for name, value in values.items():
            if name in self.names:
                params[self.names.index(name)] = value
        return params

    def matrix(self, params: Array) -> Array:
        """The camera matrix (3, 3), px."""
        fx, fy, cx, cy = params[:4]
        return np.array([[fx, params[4] if self.has_skew else 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

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
        points = np.asarray(xyz, float).reshape(-1, 3)
        uv, valid = np.empty((len(points), 2)), np.empty(len(points), bool)
        with np.errstate(all="ignore"):
            for rows in _blocks(len(points)):
                u, v, found = self._project(params, *np.ascontiguousarray(points[rows].T))
                found &= np.isfinite(u)
                found &= np.isfinite(v)
                _fill(uv[rows], (u, v), valid[rows], found)
        return uv.reshape(*np.shape(xyz)[:-1], 2), valid.reshape(np.shape(xyz)[:-1])

    def _project(self, params: Array, x: Array, y: Array, z: Array) -> tuple[Array, Array, Array]:
        """`forward` and `inside`; models that learn both from one computation override this."""
        return *self.forward(params, x, y, z), self.inside(params, x, y, z)

    def unproject(self, params: Array, uv: Array) -> tuple[Array, Array]:
        """Rays of pixels.

        Parameters
        ----------
        params : (P,) array
        uv : (..., 2) array, px

        Returns
        -------
        ray : (..., 3) array of unit length in the camera's frame; NaN outside the domain
        valid : (...) bool array
        """
        pixels = np.asarray(uv, float).reshape(-1, 2)
        ray, valid = np.empty((len(pixels), 3)), np.empty(len(pixels), bool)
        with np.errstate(all="ignore"):
            for rows in _blocks(len(pixels)):
                x, y, z, found = self.backward(params, *np.ascontiguousarray(pixels[rows].T))
                scale = x * x
                scale += y * y
                scale += z * z
                np.sqrt(scale, out=scale)
                np.divide(1.0, scale, out=scale)
                _fill(ray[rows], (x * scale, y * scale, z * scale), valid[rows], found)
        return ray.reshape(*np.shape(uv)[:-1], 3), valid.reshape(np.shape(uv)[:-1])

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
        uv, d_xyz, d_params = np.empty((1, 2, n)), np.empty((1, 3, 2, n)), np.empty((1, self.size, 2, n))
        x, y, z = (np.ascontiguousarray(c)[None] for c in xyz.T)
        with np.errstate(all="ignore"):
            valid = self.inside(params, x, y, z)[0]
            self.linearise(params, x, y, z, uv, d_xyz, d_params)
            valid &= np.isfinite(uv[0]).all(0)
        out = uv[0].T.copy(), d_xyz[0].transpose(2, 1, 0).copy(), d_params[0].transpose(2, 1, 0).copy()
        for a in out:
            a[~valid] = np.nan
        return (*out, valid)


def _blocks(count: int) -> Iterator[slice]:
    for i in range(0, count, BLOCK):
        yield slice(i, i + BLOCK)


def _fill(rows: Array, columns: tuple[Array, ...], valid: Array, found: Array) -> None:
    """Write columns into rows (N, C), NaN where they are not found."""
    for i, column in enumerate(columns):
        rows[:, i] = column
    valid[:] = found
    if not found.all():
        rows[~found] = np.nan


def no_options(name: str, plain: Sequence[str], named: dict[str, str], known: Sequence[str] = ()) -> None:
    """Refuse options that a model does not know."""
    unknown = [*plain, *(k for k in named if k not in known)]
    if unknown:
        raise UsageError(
            f"model '{name}' has no option '{unknown[0]}'.",
            f"Known: {', '.join(known)}." if known else f"Try: --model {name}",
        )


def example_list(*cameras: Any) -> list[tuple[Array, tuple[int, int]]]:
    """Collect (params, image_size) pairs as float arrays."""
    return [(np.array(params, float), size) for params, size in cameras]
