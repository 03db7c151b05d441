"""Two cameras compared for a decision: how far apart in px, and against what their uncertainties allow.

The difference is that of `difference.py`, after the transformation that a calibration leaves open. Where a
camera comes with its data, its projection uncertainty (`uncertainty.py`) stands beside: the difference d of
a pixel is

    |d| / sqrt(eᵀ (C_A + C_B) e),    e = d / |d|                                                          (1)

standard deviations, in its own direction. That counts both calibrations as independent; two calibrations of
the same pictures share their noise and differ by less. Above 3 or so everywhere, the cameras differ by more
than noise: one has changed, or a model does not hold.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from camcal.assess.checks.facts import Facts
from camcal.assess.curvature import accuracy as accuracy_of
from camcal.assess.difference import Difference, difference, image_grid
from camcal.assess.uncertainty import ProjectionUncertainty, projection_uncertainty, worst_sigma
from camcal.errors import DataError
from camcal.geometry import rotations
from camcal.model.camera import Camera
from camcal.solve.calibration import Calibration

Array = np.ndarray


@dataclass(frozen=True)
class Side:
    """A camera to compare, with what is known of its accuracy.

    `sigmas` are those of the parameters, where they were estimated; `seen` are the corners (2,) of the box
    of the points that it was calibrated with.
    """

    name: str
    camera: Camera
    uncertainty: ProjectionUncertainty | None = None
    sigmas: Mapping[str, float] = field(default_factory=dict)
    seen: tuple[Array, Array] | None = None

    @classmethod
    def of(cls, name: str, solution: Calibration) -> Side:
        """A calibration; one of which nothing was estimated counts as exact."""
        if not solution.free.shape[1] or not len(solution.poses):
            return cls(name, solution.camera)
        accuracy = accuracy_of(solution)
        sigmas = {n: s for n, s in accuracy.sigmas.items() if s > 0}
        uv = Facts(solution).image_points
        box = uv.min(0), uv.max(0)
        return cls(name, solution.camera, projection_uncertainty(solution, accuracy), sigmas, box)


@dataclass(frozen=True)
class Apart:
    """The difference at one distance; `sigmas` (N,) is (1), None where no uncertainty is known."""

    distance: float
    difference: Difference
    sigmas: Array | None

    @property
    def max_sigma(self) -> float | None:
        """The largest of (1); None where no uncertainty is known."""
        if self.sigmas is None:
            return None
        found = self.sigmas[~np.isnan(self.sigmas)]
        return float(found.max()) if len(found) else float("nan")


@dataclass(frozen=True)
class ParameterChange:
    """A parameter that both cameras have; `sigma` is that of the difference, 0 where none is known."""

    name: str
    a: float
    b: float
    sigma: float

    @property
    def change(self) -> float:
        """B less A."""
        return self.b - self.a


def common_bounds(a: Side, b: Side, size: tuple[int, int] | None = None) -> tuple[Array, Array]:
    """The corners (2,) between which two cameras are compared, px.

    Those of the picture, of (width, height) where that is given; where no camera knows the size of its
    pictures, those of the box around the points of a calibration.

    Raises
    ------
    DataError
        Where the pictures are of different sizes, or nothing is known.
    """
    sizes = list(dict.fromkeys(s.camera.image_size for s in (a, b) if s.camera.image_size is not None))
    if size is None and len(sizes) > 1:
        first, second = (f"{width}x{height}" for width, height in sizes)
        raise DataError(
            f"the cameras are for pictures of different sizes, {first} and {second}.",
            "Compare cameras of the same size, or give the size to look at: --image-size WxH",
        )
    if size or sizes:
        return np.zeros(2), np.subtract(size or sizes[0], 1.0)
    seen = [s.seen for s in (a, b) if s.seen is not None]
    if not seen:
        raise DataError("neither camera says how large its pictures are.", "Give it: --image-size 640x480")
    return np.min([low for low, _ in seen], 0), np.max([high for _, high in seen], 0)


def compare(a: Side, b: Side, bounds: tuple[Array, Array], distance: float = np.inf) -> Apart:
    """How far B projects from A between two corners (2,) of the picture, at a distance."""
    pixels = image_grid(*bounds)
    known = [s for s in (a, b) if s.uncertainty is not None]
    together, weights = np.zeros((len(pixels), 2, 2)), None
    for side in known:
        assert side.uncertainty is not None
        together = together + side.uncertainty.at_pixels(pixels, distance)
    if known:
        worst = worst_sigma(together)
        weights = np.where(np.isfinite(worst), 1 / np.maximum(worst, 1e-9) ** 2, 0.0)
        weights = weights if weights.any() else None
    apart = difference(a.camera, b.camera, pixels, None if np.isinf(distance) else distance, weights)
    return Apart(distance, apart, _in_sigmas(apart.vectors, together) if known else None)


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

    Distortion coefficients of different families share names (k1), but not their meaning: they are left out.
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
    """A bound and what was found; NaN falls."""

    name: str
    value: float
    bound: float
    unit: str = ""

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
) -> list[Gate]:
    """The gates that were asked for.

    Raises
    ------
    DataError
        Where `max_sigma` is asked for and no uncertainty is known, or a tolerance is for a parameter that the
        cameras do not share.
    """
    made = []
    for apart in found:
        where = "at infinity" if np.isinf(apart.distance) else f"at {apart.distance:g}"
        if max_px is not None:
            made.append(Gate(f"projection {where}", apart.difference.max_px, max_px, "px"))
        if max_sigma is not None:
            if apart.max_sigma is None:
                raise DataError(
                    "no uncertainty is known: neither file holds the data of its calibration.",
                    "Give a camcal report, or use --max-px.",
                )
            made.append(Gate(f"projection {where}", apart.max_sigma, max_sigma, "sigma"))
    by_name = {c.name: c for c in changes}
    for name, bound in (tolerances or {}).items():
        if name not in by_name:
            raise DataError(
                f"the cameras do not both have a parameter '{name}'.", f"They share: {', '.join(by_name)}."
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
        "gates": [
            {"name": g.name, "value": g.value, "bound": g.bound, "unit": g.unit, "passed": g.passed}
            for g in asked
        ],
        "verdict": "pass" if all(g.passed for g in asked) else "fail",
    }  # fmt: skip


def _apart(one: Apart) -> dict[str, Any]:
    d = one.difference
    lengths = d.lengths[~np.isnan(d.lengths)]
    sigmas = None if one.sigmas is None else one.sigmas[~np.isnan(one.sigmas)]
    worst = d.worst
    return {
        "distance": one.distance,
        "max_px": d.max_px,
        "rms_px": d.rms_px,
        "median_px": float(np.median(lengths)) if len(lengths) else float("nan"),
        "worst": None if worst is None else list(worst),
        "max_sigma": one.max_sigma,
        "median_sigma": None if sigmas is None or not len(sigmas) else float(np.median(sigmas)),
        "pixels": len(d.pixels),
        "pixels_outside": d.outside,
        "rotation_vector": rotations.log(d.b_from_a.rotation).tolist(),
        "translation": d.b_from_a.translation.tolist(),
    }
