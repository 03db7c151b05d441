"""The parameters of a lens model: names, groups, neutral values, bounds, and vectors of them by name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from camcal.errors import UsageError
from camcal.records import dataclass

Array = np.ndarray

#: px: a smaller focal length than this is no camera, and divides by (nearly) zero
LEAST_FOCAL = 1e-6
#: parameters of the camera matrix, which mean the same in every model
MATRIX = ("fx", "fy", "cx", "cy", "skew")


@dataclass(frozen=True)
class Parameter:
    """A parameter of a model: `group` is focal, principal, skew or distortion; the bounds are inclusive."""

    name: str
    group: str
    neutral: float = 0.0
    lower: float = -np.inf
    upper: float = np.inf


CENTRE = (Parameter("xc", "distortion"), Parameter("yc", "distortion"))


def each(params: Array) -> list[Any]:
    """The parameters as Python numbers, with which numpy is fastest; for (P, V, 1), as arrays (V, 1)."""
    return params.tolist() if params.ndim == 1 else list(params)


class Parameters:
    """The parameter vector of a lens: names, bounds and conversions.

    Attributes
    ----------
    name : str
        The spec of the model.
    parameters : tuple of Parameter
        In the order of the vector: fx, fy, cx, cy, skew if `has_skew`, xc and yc if `free_centre`, then the
        coefficients of the map.
    """

    def __init__(
        self, name: str, distortion: Sequence[Parameter], skew: bool = False, free_centre: bool = False
    ):
        self.name, self.has_skew, self.free_centre = name, skew, free_centre
        matrix = [Parameter(n, "focal", 1.0, lower=LEAST_FOCAL) for n in MATRIX[:2]]
        matrix += [Parameter(n, "principal") for n in MATRIX[2:4]]
        matrix += [Parameter("skew", "skew")] * skew
        self.parameters = (*matrix, *(CENTRE if free_centre else ()), *distortion)
        self.names = tuple(p.name for p in self.parameters)
        self.size = len(self.parameters)
        self._bend = 5 if skew else 4  # where the distortion parameters begin, a free centre among them
        self._own = self._bend + (2 if free_centre else 0)  # where the coefficients of the map begin
        bounded = [(i, p.lower, p.upper) for i, p in enumerate(self.parameters)]
        self._bounds = tuple(b for b in bounded if b[1] > -np.inf or b[2] < np.inf)

    @property
    def neutral(self) -> Array:
        """The parameters (P,) of focal length 1 without distortion."""
        return np.array([p.neutral for p in self.parameters])

    def index(self, name: str) -> int:
        """The index of a parameter; UsageError for an unknown name."""
        if name not in self.names:
            raise UsageError(
                f"model '{self.name}' has no parameter '{name}'.", "It has: " + ", ".join(self.names) + "."
            )
        return self.names.index(name)

    def check_value(self, name: str, value: float) -> None:
        """Raise a UsageError if a parameter cannot have this value."""
        p = self.parameters[self.index(name)]
        if not (p.lower <= value <= p.upper and np.isfinite(value)):
            raise UsageError(
                f"{name} = {value:g} is outside the range of the model '{self.name}': {p.lower:g} to {p.upper:g}.",
                f"Omit the value to hold {name} at its initial value.",
            )

    def within_bounds(self, params: Array) -> bool | Array:
        """Whether every parameter lies within its bounds; for parameters (P, V, 1), by view (V, 1)."""
        if params.ndim == 1:
            return all(low <= params[i] <= high for i, low, high in self._bounds)
        inside = np.ones(params.shape[1:], bool)
        for i, low, high in self._bounds:
            inside &= (low <= params[i]) & (params[i] <= high)
        return inside

    def pinhole(self, fx: float, fy: float, cx: float, cy: float, skew: float = 0.0) -> Array:
        """The parameters (P,) of a camera without distortion."""
        params = self.neutral
        params[:4] = fx, fy, cx, cy
        if self.has_skew:
            params[4] = skew
        return params

    def from_matrix(self, matrix: Array) -> Array:
        """The parameters (P,) of a camera matrix (3, 3) without distortion; a model without skew ignores the skew."""
        k = matrix / matrix[2, 2]
        return self.pinhole(k[0, 0], k[1, 1], k[0, 2], k[1, 2], k[0, 1])

    def from_values(self, values: Mapping[str, float]) -> Array:
        """The parameters (P,) with the named ones set and the rest neutral."""
        params = self.neutral
        for name, value in values.items():
            if name in self.names:
                params[self.names.index(name)] = value
        return params

    def matrix(self, params: Array) -> Array:
        """The camera matrix (3, 3), px."""
        fx, fy, cx, cy = params[:4]
        return np.array([[fx, params[4] if self.has_skew else 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
