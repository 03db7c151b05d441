"""Comparison of two cameras: their difference in px, relative to their uncertainties.

The difference is that of `difference.py`, after the transformation that a calibration does not determine. If a
camera comes with its data, the difference is related to its projection uncertainty (`uncertainty.py`): the
difference d of a pixel is

    |d| / sqrt(eᵀ (C_A + C_B) e),    e = d / |d|                                                          (1)

standard deviations, in its own direction. Both calibrations are assumed to be independent; two calibrations of
the same pictures share their noise and differ by less. If it exceeds about 3 everywhere, the cameras differ by more
than noise: one has changed, or a model does not hold.

The comparison is based on the part of the picture for which both cameras have data: the convex hull of the image points
that a camera was calibrated with, or the whole picture for a camera file without this information. Beyond it a model
extrapolates, and two correct calibrations may differ by any number of px.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, field
from typing import Any

import numpy as np

from camcal.assess.checks.facts import Facts
from camcal.assess.curvature import accuracy as accuracy_of
from camcal.assess.difference import Difference, difference, image_grid
from camcal.assess.uncertainty import ProjectionUncertainty, projection_uncertainty, worst_sigma
from camcal.errors import DataError
from camcal.geometry import hull
from camcal.model.camera import Camera
from camcal.records import dataclass
from camcal.solve.calibration import Calibration

Array = np.ndarray

#: px; lower limit of the uncertainty at a pixel, so that weights remain finite
LEAST_SIGMA = 1e-9


@dataclass(frozen=True)
class Side:
    """A camera to compare, with its known accuracy.

    `sigmas` are those of the parameters, if they were estimated; `points` (N, 2) are the image points that it
    was calibrated with.
    """

    name: str
    camera: Camera
    uncertainty: ProjectionUncertainty | None = None
    sigmas: Mapping[str, float] = field(default_factory=dict)
    points: Array | None = None

    def has_data(self, pixels: Array) -> Array:
        """Return which pixels (N, 2) lie within the convex hull of its image points, (N,) bool; all if none are
        known.
        """
        if self.points is None:
            return np.ones(len(pixels), bool)
        return hull.within(self.points, pixels)

    @classmethod
    def of(cls, name: str, solution: Calibration) -> Side:
        """Make a side of a calibration; one without estimated parameters counts as exact."""
        if not solution.free.shape[1] or not len(solution.poses):
            return cls(name, solution.camera)
        accuracy = accuracy_of(solution)
        sigmas = {n: s for n, s in accuracy.sigmas.items() if s > 0}
        points = Facts(solution).image_points
        return cls(name, solution.camera, projection_uncertainty(solution, accuracy), sigmas, points)


@dataclass(frozen=True)
class Apart:
    """The difference at one distance.

    Attributes
    ----------
    distance : float
    difference : Difference
    sigmas : (N,) array or None
        (1); None where no uncertainty is known.
    supported : (N,) bool array
        The pixels that both cameras have data for.
    """

    distance: float
    difference: Difference
    sigmas: Array | None
    supported: Array

    @property
    def max_sigma(self) -> float | None:
        """The largest value of (1) in the whole picture; None if no uncertainty is known."""
        return None if self.sigmas is None else _largest(self.sigmas, np.ones(len(self.sigmas), bool))[0]

    @property
    def inside(self) -> Inside:
        """The figures of the part of the picture for which both cameras have data."""
        lengths = self.difference.lengths
        known = lengths[self.supported & ~np.isnan(lengths)]
        nothing = float("nan")
        return Inside(
            pixels=len(known),
            rms_px=float(np.sqrt(np.mean(known**2))) if len(known) else nothing,
            p95_px=float(np.percentile(known, 95)) if len(known) else nothing,
            max_px=_largest(lengths, self.supported)[0],
            worst=self._place(lengths),
            max_sigma=None if self.sigmas is None else _largest(self.sigmas, self.supported)[0],
            worst_sigma=None if self.sigmas is None else self._place(self.sigmas),
        )

    def _place(self, values: Array) -> tuple[float, float] | None:
        index = _largest(values, self.supported)[1]
        return None if index is None else tuple(self.difference.pixels[index].tolist())


@dataclass(frozen=True)
class Inside:
    """The difference over the part of the picture for which both cameras have data; NaN if there is none.

    `worst` and `worst_sigma` are the pixels (u, v) of the largest difference in px and in standard deviations.
    """

    pixels: int
    rms_px: float
    p95_px: float
    max_px: float
    worst: tuple[float, float] | None
    max_sigma: float | None
    worst_sigma: tuple[float, float] | None


def _largest(values: Array, where: Array) -> tuple[float, int | None]:
    """The largest finite value of (N,), and its index; NaN and None if there is none."""
    found = np.flatnonzero(where & ~np.isnan(values))
    if not len(found):
        return float("nan"), None
    index = int(found[values[found].argmax()])
    return float(values[index]), index


@dataclass(frozen=True)
class ParameterChange:
    """A parameter that both cameras have; `sigma` is that of the difference, 0 if unknown."""

    name: str
    a: float
    b: float
    sigma: float

    @property
    def change(self) -> float:
        """B minus A."""
        return self.b - self.a


def common_bounds(a: Side, b: Side, size: tuple[int, int] | None = None) -> tuple[Array, Array]:
    """The corners (2,) between which two cameras are compared, px.

    Those of the picture, or of `size` if given; if no camera has an image size, those of the bounding box of the
    points of a calibration.

    Raises
    ------
    DataError
        If the pictures have different sizes, or nothing is known.
    """
    sizes = list(dict.fromkeys(s.camera.image_size for s in (a, b) if s.camera.image_size is not None))
    if size is None and len(sizes) > 1:
        first, second = (f"{width}x{height}" for width, height in sizes)
        raise DataError(
            f"the cameras are for pictures of different sizes, {first} and {second}.",
            "Compare cameras of the same size, or give the size to use: --image-size WxH",
        )
    if size or sizes:
        return np.zeros(2), np.subtract(size or sizes[0], 1.0)
    seen = [s.points for s in (a, b) if s.points is not None]
    if not seen:
        raise DataError("neither camera has an image size.", "Give it: --image-size 640x480")
    return np.min([p.min(0) for p in seen], 0), np.max([p.max(0) for p in seen], 0)


def compare(a: Side, b: Side, bounds: tuple[Array, Array], distance: float = np.inf) -> Apart:
    """The difference of the projections of B and A between two corners (2,) of the picture, at a distance."""
    pixels = image_grid(*bounds)
    known = [s for s in (a, b) if s.uncertainty is not None]
    supported = a.has_data(pixels) & b.has_data(pixels)
    together, weights = np.zeros((len(pixels), 2, 2)), supported.astype(float) if supported.any() else None
    for side in known:
        assert side.uncertainty is not None
        together = together + side.uncertainty.at_pixels(pixels, distance)
    if known:
        worst = worst_sigma(together)
        certain = np.where(np.isfinite(worst), 1 / np.maximum(worst, LEAST_SIGMA) ** 2, 0.0)
        weights = certain if certain.any() else weights
    apart = difference(a.camera, b.camera, pixels, None if np.isinf(distance) else distance, weights)
    return Apart(distance, apart, _in_sigmas(apart.vectors, together) if known else None, supported)


def _in_sigmas(vectors: Array, covariances: Array) -> Array:
    """Equation (1); 0 where the uncertainty is infinite, whatever the difference."""
    squares = np.einsum("ni,ni->n", vectors, vectors)
    infinite = np.isinf(covariances).any((1, 2))
    with np.errstate(invalid="ignore", divide="ignore"):
        along = np.einsum("ni,nij,nj->n", vectors, np.where(infinite[:, None, None], 0, covariances), vectors)
        found = np.where(squares > 0, squares / np.sqrt(along), 0.0)
    return np.asarray(np.where(infinite, np.where(np.isnan(squares), np.nan, 0.0), found))


def parameters(a: Side, b: Side) -> list[ParameterChange]:
    """The parameters that both cameras have, in the order of A's.

    Distortion coefficients of different families share names (k1), but not their meaning: they are omitted.
    """
    ours, theirs = a.camera.values, b.camera.values
    alike = type(a.camera.lens) is type(b.camera.lens)
    shared = [
        p.name for p in a.camera.lens.parameters if p.name in theirs and (alike or p.group != "distortion")
    ]
    return [
        ParameterChange(n, ours[n], theirs[n], float(np.hypot(a.sigmas.get(n, 0), b.sigmas.get(n, 0))))
        for n in shared
    ]


@dataclass(frozen=True)
class Gate:
    """A bound and the value found, with its pixel (u, v); NaN fails."""

    name: str
    value: float
    bound: float
    unit: str = ""
    place: tuple[float, float] | None = None

    @property
    def passed(self) -> bool:
        """Whether the value is within the bound."""
        return bool(self.value <= self.bound)


def gates(
    found: Sequence[Apart],
    changes: Sequence[ParameterChange],
    max_px: float | None = None,
    max_sigma: float | None = None,
    tolerances: Mapping[str, float] | None = None,
    max_rms_px: float | None = None,
    max_p95_px: float | None = None,
) -> list[Gate]:
    """The requested gates; those of projections apply to the part for which both cameras have data.

    Raises
    ------
    DataError
        If `max_sigma` is requested and no uncertainty is known, or a tolerance is for a parameter that the
        cameras do not share.
    """
    made = []
    for apart in found:
        where = "at infinity" if np.isinf(apart.distance) else f"at {apart.distance:g}"
        inside = apart.inside
        if max_px is not None:
            made.append(Gate(f"projection {where}", inside.max_px, max_px, "px", inside.worst))
        if max_rms_px is not None:
            made.append(Gate(f"rms of projection {where}", inside.rms_px, max_rms_px, "px", inside.worst))
        if max_p95_px is not None:
            name = f"95th percentile of projection {where}"
            made.append(Gate(name, inside.p95_px, max_p95_px, "px", inside.worst))
        if max_sigma is not None:
            if inside.max_sigma is None:
                raise DataError(
                    "no uncertainty is available: neither file contains the data of its calibration.",
                    "Give a camcal report, or use --max-px.",
                )
            made.append(Gate(f"projection {where}", inside.max_sigma, max_sigma, "sigma", inside.worst_sigma))
    by_name = {c.name: c for c in changes}
    for name, bound in (tolerances or {}).items():
        if name not in by_name:
            raise DataError(
                f"the cameras do not both have the parameter '{name}'.",
                f"Common parameters: {', '.join(by_name)}.",
            )
        made.append(Gate(f"parameter {name}", abs(by_name[name].change), bound))
    return made


def described(
    a: Side, b: Side, found: Sequence[Apart], changes: Sequence[ParameterChange], asked: Sequence[Gate]
) -> dict[str, Any]:
    """The comparison as one document of plain values."""
    return {
        "schema": "camcal-comparison/1",
        "a": {"name": a.name, "model": a.camera.lens.name},
        "b": {"name": b.name, "model": b.camera.lens.name},
        "projection": [_apart(one) for one in found],
        "parameters": {
            c.name: {"a": c.a, "b": c.b, "change": c.change, "sigma": c.sigma or None} for c in changes
        },
        "gates": [_gate(g) for g in asked],
        "verdict": "pass" if all(g.passed for g in asked) else "fail",
    }  # fmt: skip


def _gate(gate: Gate) -> dict[str, Any]:
    place = None if gate.place is None else list(gate.place)
    return {
        "name": gate.name,
        "value": gate.value,
        "bound": gate.bound,
        "unit": gate.unit,
        "place": place,
        "passed": gate.passed,
    }


def _apart(one: Apart) -> dict[str, Any]:
    d = one.difference
    lengths = d.lengths[~np.isnan(d.lengths)]
    sigmas = None if one.sigmas is None else one.sigmas[~np.isnan(one.sigmas)]
    worst = d.worst
    return {
        "distance": one.distance,
        "supported": asdict(one.inside),
        "max_px": d.max_px,
        "rms_px": d.rms_px,
        "median_px": float(np.median(lengths)) if len(lengths) else float("nan"),
        "worst": None if worst is None else list(worst),
        "max_sigma": one.max_sigma,
        "median_sigma": None if sigmas is None or not len(sigmas) else float(np.median(sigmas)),
        "pixels": len(d.pixels),
        "pixels_outside": d.outside,
        **d.b_from_a.entry(),
    }
