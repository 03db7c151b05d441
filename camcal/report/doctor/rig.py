"""Diagnosis of a rig calibration from its report."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import Any

import numpy as np

from camcal.assess.covariance import covariance
from camcal.assess.figures import sigma_hat
from camcal.assess.rig import baseline_sigma
from camcal.plan.solution import RigSolution
from camcal.report import table
from camcal.report.doctor.calibration import Document, gates, lost, sentence, warnings
from camcal.report.doctor.findings import Finding, Gain, diagnosis, ordered
from camcal.report.rig_uncertainty import pair

#: fraction of a point's noise above which an epipolar error of the calibration affects measurements; more pictures
#: reduce it
LARGE = 0.5


def examine(report: Document, solution: RigSolution) -> list[Finding]:
    """All findings about a rig, in order."""
    found = [*gates(report), *warnings(report, None, None), *lost(report)]
    if solution.extrinsics:
        found += _pairs(solution)
    return ordered(found)


def _pairs(solution: RigSolution) -> Iterator[Finding]:
    """Pairs whose epipolar lines are less certain than a measured point."""
    accuracy, noise = covariance(solution), sigma_hat(solution)
    for a, b in combinations(solution.rig.cameras, 2):
        found = pair(solution, accuracy, a, b)["at"]
        middle = found[0]["epipolar_px"]["median"] if found else None
        if middle is None or not middle > LARGE * noise:
            continue
        need = int(np.ceil(len(solution.poses) * (middle / (LARGE * noise)) ** 2)) - len(solution.poses)
        yield Finding(
            "uncertain-epipolar-lines",
            "better",
            f"{a} and {b}: the calibration leaves epipolar lines uncertain by {table.number(middle, 2)} px, with a "
            f"noise of {table.number(noise, 2)} px.",
            f"Take about {need} more instants with the board in both cameras, close, tilted, and in the corners.",
            Gain("epipolar lines, px", middle, LARGE * noise, "as one over the root of the instants"),
        )


def diagnose(report: Document, solution: RigSolution, source: str) -> dict[str, Any]:
    """The document about a rig."""
    found = examine(report, solution)
    return diagnosis("rig", f"{sentence(report, found)} {_known(solution)}".strip(), found, source=source)


def _known(solution: RigSolution) -> str:
    """Describe how well the baselines are known."""
    if not solution.extrinsics:
        return ""
    accuracy, said = covariance(solution), []
    for a, b in list(combinations(solution.rig.cameras, 2))[:3]:
        value = table.with_sigma(solution.rig.baseline(a, b), baseline_sigma(solution, accuracy, a, b))
        said.append(f"{a}-{b} {value[0]} ± {value[1]}")
    return f"Distances: {', '.join(said)}."
