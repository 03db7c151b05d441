"""The page of a rig: the values for its template."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np

from camcal.assess.covariance import covariance
from camcal.plan.rig_cameras import solution_within
from camcal.plan.solution import RigSolution
from camcal.report import table
from camcal.report.charts import charts
from camcal.report.charts.svg import svg
from camcal.report.doctor.rig import examine
from camcal.report.html import scene
from camcal.report.html.page import filled, parameter_rows, template_of
from camcal.report.rig_uncertainty import pair

#: charts of each camera, by name
CHARTS = ("residuals", "histogram", "views", "coverage", "distortion-curve")


def page(report: dict[str, Any], solution: RigSolution, source: str = "report.yaml") -> str:
    """The report of a rig as one self-contained HTML document; see `camcal.report.html.page.page`."""
    template = template_of("rig.html")
    return filled(
        template,
        report,
        source,
        scene.rig_drawing(solution),
        findings=examine(report, solution),
        places=_places(report["rig"]),
        pairs=_pairs(solution),
        cameras=[_camera(report, solution, name) for name in solution.rig.cameras],
    )


def _places(rig: dict[str, Any]) -> list[dict[str, Any]]:
    made = []
    for name, pose in rig["cam_from_rig"].items():
        sigmas = [pose.get("sigma_translation"), pose.get("sigma_rotation_deg")]
        shift, turn = ("held" if s is None else table.number(float(np.linalg.norm(s)), 2) for s in sigmas)
        angle = float(np.degrees(np.linalg.norm(pose["rotation_vector"])))
        made.append(
            {
                "name": name,
                "translation": [f"{t:.6g}" for t in pose["translation"]],
                "sigma": shift,
                "turned": f"{angle:.5g}",
                "sigma_deg": turn,
            }
        )
    return made


def _pairs(solution: RigSolution) -> list[dict[str, str]]:
    accuracy, made = covariance(solution), []
    for a, b in combinations(solution.rig.cameras, 2):
        found = pair(solution, accuracy, a, b)
        held = not solution.extrinsics
        value, sigma = table.with_sigma(
            found["baseline"]["value"], None if held else found["baseline"]["sigma"]
        )
        at = found["at"][0]["epipolar_px"] if found["at"] and not held else {"median": None, "worst": None}
        made.append(
            {
                "name": f"{a}-{b}",
                "distance": value,
                "sigma": sigma,
                "rms": table.number(found["epipolar_residuals"]["rms"], 3),
                "median": table.number(at["median"], 2),
                "worst": table.number(at["worst"], 2),
            }
        )
    return made


def _camera(report: dict[str, Any], solution: RigSolution, name: str) -> dict[str, Any]:
    entry = report["cameras"][name]
    drawn = charts(solution_within(solution, name), CHARTS)
    size = ", pictures of {}x{}".format(*entry["image_size"]) if entry["image_size"] else ""
    return {
        "name": name,
        "caption": f"{entry['model']}{size}; parameters with one standard deviation.",
        "parameters": parameter_rows(entry),
        "charts": [(chart, svg(chart, f"{name}-{kind}")) for kind, chart in drawn.items()],
    }
