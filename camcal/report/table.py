"""The report for the terminal: tables for stdout, and a summary of verdict and warnings, within 80 columns.

Both take the document, not the solution, so that a report read from a file shows the same.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from camcal.system.text import counted

Document = Mapping[str, Any]

#: views of a complete table; of more, the worst are shown
ALL_VIEWS = 24
NAMED = 4  #: names in a sentence
MOST_PLACES = 12  #: decimal places; sigmas of exact data would require more than a double has
WORST_VIEWS = 10  #: rows of the table if there are many views
_STYLE = {
    "pass": "green",
    "fail": "bold red",
    "not_applicable": "dim",
    "used": "",
    "rejected": "yellow",
    "wrong": "bold red",
    "doubtful": "yellow",
    "note": "dim",
    "good": "green",
}


def tables(report: Document) -> RenderableType:
    """Parameters, views, stages and cross-check of a report."""
    parts = [parameters_table(report["camera"]), fit_table(report["fit"]), _views(report["views"])]
    shape = (report.get("target") or {}).get("shape")
    if shape:
        parts.append(board_table(shape))
    if report["stages"]:
        parts.append(_stages(report["stages"]))
    if report["crosscheck"]:
        parts.append(crosscheck_table(report["crosscheck"]))
    return spaced(parts)


def spaced(parts: Iterable[RenderableType]) -> RenderableType:
    """The parts with an empty line between them."""
    return Group(*[line for part in parts for line in (part, Text(""))][:-1])


def summary(report: Document) -> RenderableType:
    """The warnings with their hints, the failed gates, and last the verdict in a sentence."""
    lines: list[RenderableType] = []
    for warning in report["warnings"]:
        severity = warning["severity"]
        head = (f"{severity} ", _STYLE[severity])
        lines.append(Text.assemble(head, (warning["code"], "bold"), f": {warning['message']}"))
        if warning["hint"]:
            lines.append(Padding(Text(warning["hint"]), (0, 0, 0, 2)))
    for failure in report.get("failures", []):
        if failure.startswith("graded "):
            continue  # it is listed above, as a warning
        lines.append(Text.assemble(("failed ", "bold red"), failure))
    verdict = report["verdict"]
    lines.append(Text.assemble((verdict.upper(), _STYLE[verdict]), f": {sentence(report)}"))
    return Group(*lines)


def sentence(report: Document) -> str:
    """Describe the result in one sentence."""
    fit = report["fit"]
    used = sum(v["status"] == "used" for v in report["views"])
    models = (
        [report["camera"]["model"]]
        if "camera" in report
        else [c["model"] for c in report["cameras"].values()]
    )
    said = (
        f"{', '.join(dict.fromkeys(models))} from {counted(fit['points_used'], 'point')} in {counted(used, 'view')}, "
        f"rms {number(fit['rms_point'])} px (95 % of the points below {number(fit['p95'])} px)"
    )
    if not fit["converged"]:
        said += ", not converged"
    entries = report["crosscheck"]
    if entries:
        own = [e for e in entries if e["stage"] == "refine" and "calibrate" in e["against"].lower()]
        agree = sum(e["status"] == "pass" for e in entries)
        asked = sum(e["status"] != "not_applicable" for e in entries)
        if any(e["status"] != "not_applicable" for e in own):
            said += f"; OpenCV {report['tool']['opencv']} agrees in {agree} of {asked} cross-checks"
        else:
            parts = f" and agrees in {agree} of {asked} cross-checks of its parts" if asked else ""
            said += f"; OpenCV {report['tool']['opencv']} has no calibration to compare the whole with{parts}"
    said += f"; {report.get('grade', 'good')}"
    if report["warnings"]:
        said += f", {counted(len(report['warnings']), 'warning')}"
    return said + "."


def number(value: float | None, digits: int = 4) -> str:
    """A number with `digits` significant digits, so that columns align; a dash for None."""
    if value is None or math.isnan(value):
        return "-"
    return "0" if value == 0 else f"{value:#.{digits}g}".rstrip(".")


def with_sigma(value: float, sigma: float | None) -> tuple[str, str]:
    """A value and its sigma as text: sigma to two significant digits, the value to the same decimal place."""
    if sigma is None or not math.isfinite(sigma) or sigma <= 0:
        shown = "" if sigma is None or sigma == 0 else "undetermined" if math.isinf(sigma) else "-"
        return f"{value:.6g}", shown
    places = min(max(1 - math.floor(math.log10(sigma)), 0), MOST_PLACES)
    return f"{value:.{places}f}", f"{sigma:.{places}f}" if places else f"{sigma:.0f}"


def table(title: str, *columns: str, left: Sequence[str] = ()) -> Table:
    """A table whose first column is left-aligned, and the others right-aligned except those in `left`."""
    made = Table(title=title, title_justify="left", title_style="bold", box=None, pad_edge=False)
    for name in columns:
        on_the_left = name == columns[0] or name in left
        made.add_column(name, justify="left" if on_the_left else "right", no_wrap=True, overflow="ellipsis")
    return made


def parameters_table(camera: Mapping[str, Any], name: str = "") -> Table:
    """The parameters of a camera; `name` is its name in a rig."""
    size = "x".join(map(str, camera["image_size"] or ())) or "of unknown size"
    head = f"{name}: " if name else ""
    made = table(f"{head}{camera['model']}, pictures {size}", "parameter", "value", "± sigma", "start")
    for name, p in camera["parameters"].items():
        value, sigma = with_sigma(p["value"], p["sigma"])
        made.add_row(name, value, "fixed" if p["fixed"] else sigma, f"{p['start']:.6g}")
    return made


def fit_table(fit: Mapping[str, Any]) -> Table:
    """The error figures."""
    made = table(
        "reprojection error, px", "rms_point", "rms_coord", "sigma_hat", "median", "p95", "max", "points"
    )
    made.columns[0].justify = "right"
    figures = [number(fit[k]) for k in ("rms_point", "rms_coord", "sigma_hat", "median", "p95", "max")]
    rejected = fit["points_rejected"]
    made.add_row(*figures, f"{fit['points_used']}" + (f" (+{rejected} rejected)" if rejected else ""))
    return made


def _views(views: Sequence[Mapping[str, Any]]) -> RenderableType:
    used = [v for v in views if v["status"] == "used"]
    title, shown = f"views ({len(used)} of {len(views)} used)", list(views)
    if len(views) > ALL_VIEWS:
        worst = sorted(used, key=lambda v: -_or_zero(v["rms_point"]))[:WORST_VIEWS]
        others = [v for v in views if v["status"] != "used"]
        shown = worst + others[:WORST_VIEWS]
        title += f": the {len(worst)} worst" + (" and unused ones" if others else "")
        if len(others) > WORST_VIEWS:
            title += f" (first {WORST_VIEWS})"
    made = table(title, "view", "points", "rms", "", left=[""])
    made.columns[0].max_width = 30
    made.columns[3].overflow, made.columns[3].no_wrap = "fold", False
    top = max((_or_zero(v["rms_point"]) for v in used), default=0.0)
    for v in shown:
        note: RenderableType = Text("█" * round(16 * _or_zero(v["rms_point"]) / top) if top else "")
        if v["status"] != "used":
            said = v["status"].replace("_", " ") + (f": {v['reason']}" if v["reason"] else "")
            note = Text(said, style=_STYLE.get(v["status"], "yellow"))
        points = str(v["points"]) + (f" (-{v['rejected_points']})" if v["rejected_points"] else "")
        made.add_row(escape(v["id"]), points, number(v["rms_point"]), note)
    return made


def board_table(shape: Mapping[str, Any]) -> RenderableType:
    """The board's shape in words, and the errors of each shape that was tried."""
    taken = shape["kind"] + (f", from {shape['from']}" if shape.get("from") else "")
    parts: list[RenderableType] = [Text(f"board: {taken}", style="bold")]
    if shape.get("words"):
        parts.append(Padding(Text(shape["words"]), (0, 0, 0, 2)))
    if shape.get("turned"):
        names = shape["turned"]
        some = ", ".join(names[:NAMED]) + (", ..." if len(names) > NAMED else "")
        said = f"rotated by 180 degrees relative to the others, and renumbered: {len(names)} views ({some})"
        parts.append(Padding(Text(said), (0, 0, 0, 2)))
    if shape.get("tried") and not shape.get("from"):
        made = table("", "tried", "rms", "hold-out", "p")
        made.title = None
        for t in shape["tried"]:
            p = "-" if t["kind"] == "flat" else f"{t['p_value']:.1g}" if t["p_value"] else "< 1e-300"
            made.add_row(t["kind"], number(t["rms_point"]), number(t["holdout_rms_point"]), p)
        parts.append(made)
    return Group(*parts)


def _or_zero(value: float | None) -> float:
    return 0.0 if value is None or math.isnan(value) else value


def _stages(stages: Sequence[Mapping[str, Any]]) -> Table:
    made = table("stages", "stage", "rms", "fx", "fy", "cx", "cy", "skew", "ms")
    for s in stages:
        k = s["matrix"]
        cells = (
            ["-"] * 5
            if k is None
            else [number(k[i][j], 6) for i, j in ((0, 0), (1, 1), (0, 2), (1, 2), (0, 1))]
        )
        made.add_row(
            escape(s["name"]), number(s["rms_point"], 5), *cells, number(1e3 * _or_zero(s["seconds"]), 3)
        )
    return made


def crosscheck_table(entries: Sequence[Mapping[str, Any]]) -> RenderableType:
    """Each stage compared with cv2, and what was compared or why it was not."""
    made = table(
        "cross-check", "stage", "against", "status", "rms of cv2", "apart, px", left=["against", "status"]
    )
    reasons: list[RenderableType] = []
    for e in entries:
        status = e["status"]
        there, difference = e.get("opencv") or {}, e.get("difference") or {}
        made.add_row(
            escape(e["stage"]),
            escape(e["against"]),
            Text(status.replace("_", " "), style=_STYLE[status]),
            number(there.get("rms_point"), 6),
            number(difference.get("projection_max_px"), 3),
        )
        if e.get("why"):
            why = f"{e['stage']}, {e['against']}: {e['why']}"
            reasons.append(Padding(Text(why, style="dim"), (0, 0, 0, 2)))
    return Group(made, *reasons)
