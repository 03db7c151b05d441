"""The report's `bias`: tests of the residuals for systematic errors, and the influence of each view."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from camcal.assess.bias import bias_ratio, residual_tests, standardise
from camcal.assess.covariance import Covariance
from camcal.assess.design import Design
from camcal.assess.figures import redundancy
from camcal.assess.holdout import CHEAP_POINTS
from camcal.assess.influence import bootstrap, influence, jackknife
from camcal.plan.solution import Solution

LEAST_REDUNDANCY = 10  #: a sigma from ten redundant coordinates is known to sqrt(1 / 20) = 22 %
REPLICATES = 200  #: a standard deviation from 200 draws is known to 5 %, 1 / sqrt(2 · 200)


def section(solution: Solution, accuracy: Covariance) -> dict[str, Any] | None:
    """Tests, bias ratio, bootstrap and the views' influence; None for a large or an undetermined problem."""
    lost = bool(np.isnan(solution.used_residuals).any())
    if solution.observations.point_count > CHEAP_POINTS or redundancy(solution) < LEAST_REDUNDANCY or lost:
        return None
    design = Design(solution)
    ratio = bias_ratio(design)
    made: dict[str, Any] = {
        "tests": [asdict(t) for t in residual_tests(standardise(design))],
        "ratio": None if ratio is None else asdict(ratio),
        "sigma_ratios": None,
        "influence": None,
    }
    if design.transform.shape[1] and len(design.views) > 2 and not accuracy.null.size:
        made |= _views(design, accuracy, int(_seed(solution)))
    return made


def _seed(solution: Solution) -> int:
    given = solution.options.get("seed", 0)
    return given["value"] if isinstance(given, dict) else given


def _views(design: Design, accuracy: Covariance, seed: int) -> dict[str, Any]:
    found = influence(design)
    own = design.transform.shape[1]
    sigmas = np.sqrt(np.diag(accuracy.free)[:own])
    names = _free_names(design)
    ratios = {
        "jackknife": np.sqrt(np.diag(jackknife(found))) / sigmas,
        "bootstrap": np.sqrt(np.diag(bootstrap(design, REPLICATES, seed))) / sigmas,
    }
    return {
        "sigma_ratios": {
            "replicates": REPLICATES,
            **{
                kind: {n: float(f"{r:.3g}") for n, r in zip(names, values, strict=True)}
                for kind, values in ratios.items()
            },
        },
        "influence": [
            {
                "view": view.id,
                "cook": float(f"{found.cook[i]:.4g}"),
                "p_value": float(f"{found.p_values[i]:.4g}"),
                "information": float(f"{found.share[i]:.4g}"),
            }
            for i, view in enumerate(design.views)
        ],
    }


def _free_names(design: Design) -> list[str]:
    """The first parameter that each free direction changes: itself, or fx for a coupled fy."""
    names = design.calibration.camera.lens.names
    return [names[int(np.flatnonzero(column)[0])] for column in design.transform.T]
