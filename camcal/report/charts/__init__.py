"""The report's charts as data, drawn as themed SVG for a page or by matplotlib for files.

A chart is a function `Solution -> Chart or None` and a line in `CHARTS`, in the order of a page.
"""

from __future__ import annotations

from collections.abc import Collection

from camcal.plan.solution import Solution
from camcal.registry import load
from camcal.report.charts.base import Chart

CHARTS: dict[str, str] = {
    "residuals": "camcal.report.charts.residuals:quiver",
    "histogram": "camcal.report.charts.residuals:histogram",
    "views": "camcal.report.charts.residuals:views",
    "radius": "camcal.report.charts.residuals:by_radius",
    "coverage": "camcal.report.charts.coverage:image",
    "tilts": "camcal.report.charts.coverage:tilts",
    "distances": "camcal.report.charts.coverage:distances",
    "next-view": "camcal.report.next_view:chart",
    "distortion-curve": "camcal.report.charts.lens:curve",
    "distortion-field": "camcal.report.charts.lens:field",
    "uncertainty-board": "camcal.report.charts.lens:uncertainty_at_board",
    "uncertainty-infinity": "camcal.report.charts.lens:uncertainty_at_infinity",
    "holdout": "camcal.report.charts.lens:holdout_map",
    "board-shape": "camcal.report.charts.board:shape",
}


def charts(solution: Solution, names: Collection[str] = tuple(CHARTS)) -> dict[str, Chart]:
    """The charts for which a solution has data, all or those of some names, by name."""
    made = {name: load(path)(solution) for name, path in CHARTS.items() if name in names}
    return {name: chart for name, chart in made.items() if chart is not None}
