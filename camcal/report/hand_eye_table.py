"""A hand-eye calibration for the terminal, within 80 columns."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from camcal.report.table import number, with_sigma
from camcal.routes.hand_eye import NAMES
from camcal.system.text import counted

Document = Mapping[str, Any]

_STYLE = {"pass": "bold green", "fail": "bold red", "wrong": "bold red", "doubtful": "yellow", "note": "dim"}


def summary(report: Document) -> RenderableType:
    """Warnings and the verdict, for stderr."""
    lines: list[RenderableType] = []
    for warning in report["warnings"]:
        severity = warning["severity"]
        lines.append(Text.assemble((f"{severity} ", _STYLE[severity]), warning["message"]))
        if warning["hint"]:
            lines.append(Padding(Text(warning["hint"]), (0, 0, 0, 2)))
    verdict = report["verdict"]
    lines.append(Text.assemble((verdict.upper(), _STYLE[verdict]), f": {sentence(report)}"))
    return Group(*lines)


def sentence(report: Document) -> str:
    """Describe the result in one sentence."""
    h = report["hand_eye"]
    robot = h["robot"]
    said = (
        f"{NAMES[h['setup']][0]} from {counted(h['poses'], 'pose')}, robot off by "
        f"{number(robot['translation_rms'], 3)} and {number(robot['rotation_rms_deg'], 2)} deg, image by "
        f"{number(h['image']['rms_point'], 3)} px; {report['grade']}"
    )
    if report["warnings"]:
        said += f", {counted(len(report['warnings']), 'warning')}"
    return said + "."


def tables(report: Document) -> RenderableType:
    """The transformations, the closed forms, the suggested poses."""
    h = report["hand_eye"]
    first, second = NAMES[h["setup"]]
    parts: list[RenderableType] = [_pose(first, h[first]), Text(""), _pose(second, h[second]), Text("")]
    if "time_offset" in h:
        value, sigma = with_sigma(h["time_offset"]["value"], h["time_offset"]["sigma"])
        parts += [Text(f"time offset {value} ± {sigma} s, to be added to the camera's time"), Text("")]
    if "camera" in h:
        parts += [_camera(h["camera"]), Text("")]
    parts += [_methods(h["methods"]), Text(""), _worst(h["views"])]
    if h["next"]:
        parts += [Text(""), _next(h["next"])]
    return Group(*parts)


def _table(title: str, *columns: str) -> Table:
    made = Table(title=title, title_justify="left", title_style="bold", box=None, pad_edge=False)
    for name in columns:
        made.add_column(name, justify="left" if name == columns[0] else "right", overflow="fold")
    return made


def _pose(name: str, pose: Mapping[str, Any]) -> Table:
    made = _table(name, "", "x", "± sigma", "y", "± sigma", "z", "± sigma")
    degrees = [v * 57.29577951308232 for v in pose["rotation_vector"]]
    for label, values, sigmas in (
        ("rotation vector, deg", degrees, pose["sigma_rotation_deg"]),
        ("translation", pose["translation"], pose["sigma_translation"]),
    ):
        cells = [cell for v, s in zip(values, sigmas, strict=True) for cell in with_sigma(v, s)]
        made.add_row(label, *cells)
    return made


def _camera(parameters: Mapping[str, Mapping[str, Any]]) -> Table:
    table = _table(
        "camera, refined with the transform", "parameter", "value", "sigma", "by the pictures", "sigma"
    )
    for name, p in parameters.items():
        if p["sigma_before"] > 0:
            pairs = (with_sigma(p[v], p[s]) for v, s in (("value", "sigma"), ("before", "sigma_before")))
            table.add_row(name, *(cell for pair in pairs for cell in pair))
    return table


def _methods(methods: list[Mapping[str, Any]]) -> Table:
    made = _table("closed forms", "", "translation", "left", "deg left", "paper")
    for m in methods:
        where = "failed" if m["translation"] is None else " ".join(number(c, 5) for c in m["translation"])
        made.add_row(
            m["name"], where, number(m["translation_rms"], 3), number(m["rotation_rms_deg"], 3), m["paper"]
        )
    return made


def _worst(views: list[Mapping[str, Any]]) -> Table:
    """The poses with the largest residuals, and all outliers."""
    used = [v for v in views if v["status"] == "used"]
    used.sort(key=lambda v: -sum(c * c for c in v["translation_residual"]))
    made = _table(f"residuals of {len(used)} poses", "the largest", "translation", "deg", "")
    for v in used[:5]:
        length = sum(c * c for c in v["translation_residual"]) ** 0.5
        made.add_row(escape(v["id"]), number(length, 3), number(v["rotation_residual_deg"], 3), "")
    for v in views:
        if v["status"] != "used":
            made.add_row(escape(v["id"]), "-", "-", "outlier")
    return made


def _next(poses: list[Mapping[str, Any]]) -> Table:
    made = _table("poses to add, base_from_hand", "translation", "rotation vector, rad", "sigma then")
    for p in poses:
        hand = p["base_from_hand"]
        made.add_row(
            " ".join(number(c, 5) for c in hand["translation"]),
            " ".join(f"{c:.3f}" for c in hand["rotation_vector"]),
            " ".join(number(c, 2) for c in p["sigma_translation"]),
        )
    return made
