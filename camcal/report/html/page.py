"""The page: the values for the template."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from camcal.errors import UsageError
from camcal.plan.solution import Solution
from camcal.report import table, words
from camcal.report.charts import charts
from camcal.report.charts.svg import svg
from camcal.report.doctor.calibration import examine
from camcal.report.html import pictures, scene

_HERE = Path(__file__).parent
#: charts in sections of the page, by name
SECTIONS = {
    "residuals": ("residuals", "histogram", "views", "radius"),
    "coverage": ("coverage", "tilts", "distances", "next-view"),
    "lens": ("distortion-curve", "distortion-field", "uncertainty-board", "uncertainty-infinity", "holdout"),
    "board": ("board-shape",),
}


def page(report: dict[str, Any], solution: Solution, source: str = "report.yaml") -> str:
    """A report as one self-contained HTML document.

    Parameters
    ----------
    report : dict
        The document.
    solution : Solution
        The same, as `camcal.report.loading.from_document` makes it.
    source : str
        Where the report was read; pictures are also searched relative to its folder.

    Raises
    ------
    UsageError
        If jinja2 is not installed.
    """
    template = template_of("page.html")
    shown, on_pictures = pictures.thumbnails(solution, report, Path(source).resolve().parent)
    return filled(
        template,
        report,
        source,
        scene.drawing(solution),
        findings=examine(report, solution, source, try_models=False),
        parameters=parameter_rows(report["camera"]),
        code=code_of(solution),
        preview=pictures.preview(solution, report, Path(source).resolve().parent),
        charts={name: (chart, svg(chart, name)) for name, chart in charts(solution).items()},
        sections=SECTIONS,
        thumbnails=shown,
        on_pictures=on_pictures,
    )


def filled(template: Any, report: dict[str, Any], source: str, turned: dict[str, Any], **own: Any) -> str:
    """A page: the common parts of a camera's and a rig's, and the parts of its `own`.

    Parameters
    ----------
    template : jinja2.Template
        One that extends `_base.html`.
    report : dict
    source : str
        Where the report was read.
    turned : dict
        The drawing of the cameras and boards in space.
    **own
        Further values of the template.
    """
    # a closing tag inside the data would end the script
    scene_data = json.dumps(turned["data"], separators=(",", ":")).replace("<", "\\u003c")
    scripts = (_HERE.joinpath(n).read_text(encoding="utf-8") for n in ("scene.js", "page.js"))
    return str(
        template.render(
            report=report,
            source=source,
            sentence=table.sentence(report),
            trust=words.trust(report),
            taken=words.taken(report),
            scene=turned,
            scene_data=scene_data,
            number=table.number,
            style=_HERE.joinpath("style.css").read_text(encoding="utf-8"),
            script="".join(scripts),
            **own,
        )
    )


def template_of(name: str) -> Any:
    """A template of this folder; UsageError if jinja2 is not installed."""
    try:
        from jinja2 import Environment, FileSystemLoader, StrictUndefined
    except ImportError:
        raise UsageError(
            "the HTML report needs jinja2, which is not installed.", "Try: pip install 'camcal[report]'"
        ) from None
    environment = Environment(
        loader=FileSystemLoader(_HERE),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(name)


def code_of(solution: Solution) -> str:
    """The camera as Python code to copy: K and dist for OpenCV, or the parameters by name if OpenCV has no such
    model.
    """
    camera = solution.camera
    try:
        k, dist = camera.opencv()
    except UsageError:
        values = ", ".join(
            f'"{n}": {v!r}' for n, v in zip(camera.lens.names, camera.params.tolist(), strict=True)
        )
        return f'model = "{camera.lens.name}"\nparameters = {{{values}}}'
    rows = ",\n     ".join(str(row) for row in k.tolist())
    return f"K = [{rows}]\ndist = {np.ravel(dist).tolist()}  # {camera.lens.name}"


def parameter_rows(camera: dict[str, Any]) -> list[dict[str, str]]:
    """The parameters of a camera's entry as text."""
    rows = []
    for name, p in camera["parameters"].items():
        value, sigma = table.with_sigma(p["value"], p["sigma"])
        rows.append(
            {
                "name": name,
                "value": value,
                "sigma": "held" if p["fixed"] else sigma,
                "start": f"{p['start']:.5g}",
            }
        )
    return rows
