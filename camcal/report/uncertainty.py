"""The report's `uncertainty`: the effect of noise on projections, over the image and at two distances."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from camcal.assess.checks.facts import Facts
from camcal.assess.covariance import Covariance
from camcal.assess.uncertainty import (
    ProjectionUncertainty,
    UncertaintyMap,
    board_distance,
    map_over_image,
    projection_uncertainty,
    worst_sigma,
)
from camcal.errors import DataError
from camcal.plan.solution import Solution

Array = np.ndarray


def section(solution: Solution, accuracy: Covariance | None = None) -> dict[str, Any] | None:
    """Maps at the median board distance and at infinity; None if no camera parameter was estimated."""
    if not solution.free.shape[1] or not len(solution.poses):
        return None
    uncertainty = projection_uncertainty(solution, accuracy)
    low, high = Facts(solution).low_high
    distance = board_distance(solution)
    maps = [map_over_image(uncertainty, low, high, d) for d in (distance, np.inf)]
    return {
        "method": "mean-pcam",
        "board_distance": distance,
        "maps": [_entry(one, uncertainty) for one in maps],
    }


def _entry(found: UncertaintyMap, uncertainty: ProjectionUncertainty) -> dict[str, Any]:
    u, v, sigma = found.worst
    middle = (found.pixels[0, 0] + found.pixels[-1, -1]) / 2
    return {
        "distance": found.distance,
        "median": rounded(found.median),
        "worst": {"u": rounded(u), "v": rounded(v), "sigma_px": rounded(sigma)},
        "centre": point(uncertainty, middle, found.distance),
        "u": [rounded(x) for x in found.pixels[0, :, 0]],
        "v": [rounded(x) for x in found.pixels[:, 0, 1]],
        "sigma_px": [[rounded(x) for x in row] for row in found.sigmas],
    }


def point(uncertainty: ProjectionUncertainty, pixel: Array, distance: float) -> dict[str, Any]:
    """The answer of `camcal uncertainty` for one pixel: the worst direction's sigma, and the covariance, px²."""
    covariance = uncertainty.at_pixels(np.asarray(pixel, float)[None], distance)
    return {
        "u": float(pixel[0]),
        "v": float(pixel[1]),
        "distance": float(distance),
        "sigma_px": float(worst_sigma(covariance)[0]),
        "covariance": covariance[0],
    }


def rounded(value: float, digits: int = 5) -> float:
    """A value of a map, rounded to `digits` significant digits, which suffice for display."""
    return float(f"{value:.{digits}g}")


def inquire(
    solution: Solution, pixels: Sequence[tuple[float, float]] = (), distances: Sequence[float] = ()
) -> dict[str, Any]:
    """The answer of `camcal uncertainty`.

    Parameters
    ----------
    solution : Solution
    pixels : sequence of (u, v)
        None: the image's centre and the worst place of the map.
    distances : sequence of float
        None: that of the boards, and infinity.

    Raises
    ------
    DataError
        If the report holds a camera of which nothing was estimated, or a pixel has no ray.
    """
    if not solution.free.shape[1] or not len(solution.poses):
        raise DataError(
            "no parameter of this camera was estimated, so its uncertainty is unknown.",
            "Give the report of a calibration, not of `camcal evaluate`.",
        )
    uncertainty = projection_uncertainty(solution)
    low, high = Facts(solution).low_high
    usual = board_distance(solution)
    maps, points = [], []
    for distance in distances or (usual, np.inf):
        found = map_over_image(uncertainty, low, high, distance)
        maps.append(_entry(found, uncertainty))
        asked = [("", np.array(p)) for p in pixels] or [
            ("centre", (low + high) / 2),
            ("worst", np.array(found.worst[:2])),
        ]
        points += [{"what": what} | point(uncertainty, pixel, distance) for what, pixel in asked]
    for entry in points:
        if np.isnan(entry["sigma_px"]):
            raise DataError(
                f"the lens model has no ray for the pixel ({entry['u']:g}, {entry['v']:g}).",
                "Choose a pixel nearer to the image centre.",
            )
    unit = (solution.observations.target or {}).get("unit")
    return {
        "method": "mean-pcam",
        "unit": unit,
        "board_distance": usual,
        "points": points,
        "maps": [] if pixels else maps,
    }
