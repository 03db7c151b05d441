"""The answer of `camcal uncertainty` for a rig: its cameras, and the accuracy of each pair."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Any

import numpy as np

from camcal.assess.covariance import Covariance, covariance
from camcal.assess.figures import sigma_hat
from camcal.assess.rig import baseline_sigma
from camcal.assess.rig_pairs import board_distance, epipolar_residuals, pair_uncertainty
from camcal.errors import DataError
from camcal.plan.rig_cameras import solution_within
from camcal.plan.solution import RigSolution
from camcal.report.uncertainty import inquire as inquire_camera


def inquire(
    solution: RigSolution, pixels: Sequence[tuple[float, float]] = (), distances: Sequence[float] = ()
) -> dict[str, Any]:
    """The uncertainty of each camera, and of each pair.

    Parameters
    ----------
    solution : RigSolution
    pixels : sequence of (u, v)
        As of one camera.
    distances : sequence of float
        None: that of the boards.

    Raises
    ------
    DataError
        If nothing of the rig was estimated.
    """
    if not solution.extrinsics:
        raise DataError(
            "no parameter of this rig was estimated, so its uncertainty is unknown.",
            "Give the report of `camcal rig`, not of `camcal evaluate`.",
        )
    accuracy = covariance(solution)
    cameras = {
        name: inquire_camera(solution_within(solution, name), pixels, distances)
        for name in solution.rig.cameras
        if _is_free(solution, name)
    }
    pairs = {
        f"{a}-{b}": pair(solution, accuracy, a, b, distances)
        for a, b in combinations(solution.rig.cameras, 2)
    }
    unit = (solution.observations.target or {}).get("unit")
    return {"method": "mean-pcam", "unit": unit, "cameras": cameras, "pairs": pairs}


def _is_free(solution: RigSolution, name: str) -> bool:
    """Return whether any of a camera's intrinsics were estimated."""
    rows = [n.startswith(f"{name}.") for n in solution.names]
    return bool(solution.free[np.array(rows)].any())


def pair(
    solution: RigSolution, accuracy: Covariance, a: str, b: str, distances: Sequence[float] = ()
) -> dict[str, Any]:
    """The accuracy of a pair of cameras at given distances from the first; by default at the boards' distance."""
    noise = sigma_hat(solution)
    at = [
        _figures(pair_uncertainty(solution, accuracy, a, b, d, noise))
        for d in (distances or (board_distance(solution, a),))
        if np.isfinite(d)
    ]
    off = epipolar_residuals(solution, a, b)
    return {
        "baseline": {"value": solution.rig.baseline(a, b), "sigma": baseline_sigma(solution, accuracy, a, b)},
        "epipolar_residuals": {
            "points": len(off),
            "rms": float(np.sqrt(np.square(off).mean())) if len(off) else None,
        },
        "at": at,
    }


def _figures(found: Any) -> dict[str, Any]:
    def middle(values: np.ndarray) -> float | None:
        return float(np.median(values)) if len(values) else None

    def worst(values: np.ndarray) -> float | None:
        return float(values.max()) if len(values) else None

    return {
        "distance": found.distance,
        "pixels": len(found.pixels),
        "epipolar_px": {"median": middle(found.epipolar), "worst": worst(found.epipolar)},
        "point": {"median": middle(found.point), "worst": worst(found.point)},
        "point_of_calibration": {
            "median": middle(found.of_calibration),
            "worst": worst(found.of_calibration),
        },
    }
