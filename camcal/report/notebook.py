"""A solution as an HTML table for notebooks."""

from __future__ import annotations

from html import escape

from camcal.assess.covariance import covariance
from camcal.plan.solution import Solution
from camcal.report.table import with_sigma
from camcal.system.text import counted


def table(solution: Solution) -> str:
    """The parameters with their sigmas, the error and the grade, as HTML."""
    sigmas = covariance(solution).sigmas
    fixed = [not row.any() for row in solution.free]
    rows = []
    for (name, value), held in zip(solution.camera.values.items(), fixed, strict=True):
        shown, sigma = with_sigma(value, None if held else sigmas[name])
        rows.append(f"<tr><th>{escape(name)}</th><td>{shown}</td><td>{'fixed' if held else sigma}</td></tr>")
    head = f"{solution.camera.lens.name}, {counted(len(solution.poses), 'view')}, rms {solution.rms_point:.4g} px"
    return (
        f"<table><caption>{escape(head)}: {solution.verdict}, {solution.grade}</caption>"
        "<tr><th>parameter</th><th>value</th><th>&plusmn; sigma</th></tr>" + "".join(rows) + "</table>"
    )
