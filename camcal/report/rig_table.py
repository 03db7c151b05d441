"""The report of a rig for the terminal: its cameras, their poses, the pictures by camera."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from rich.console import Group, RenderableType
from rich.markup import escape
from rich.text import Text

from camcal.report.table import (
    board_table,
    crosscheck_table,
    fit_table,
    number,
    parameters_table,
    spaced,
    table,
    with_sigma,
)

Document = Mapping[str, Any]


def tables(report: Document) -> RenderableType:
    """The cameras, their poses, the pictures by camera, and the cross-check of a report."""
    parts: list[RenderableType] = [
        parameters_table(camera, name) for name, camera in report["cameras"].items()
    ]
    parts += [_places(report["rig"]), fit_table(report["fit"]), _pictures(report)]
    shape = (report.get("target") or {}).get("shape")
    if shape:
        parts.append(board_table(shape))
    if report["crosscheck"]:
        parts.append(crosscheck_table(report["crosscheck"]))
    return spaced(parts)


def _places(rig: Mapping[str, Any]) -> RenderableType:
    made = table(
        f"relative to {rig['reference']}", "camera", "x", "y", "z", "turned, deg", "sigma", "sigma, deg"
    )
    for name, pose in rig["cam_from_rig"].items():
        made.add_row(escape(name), *_cells(pose))
    distances = table("distances", "pair", "value", "sigma")
    for pair, found in (rig.get("baselines") or {}).items():
        distances.add_row(escape(pair), *with_sigma(found["value"], found["sigma"]))
    parts: list[RenderableType] = [made, Text(""), distances]
    if rig.get("boards"):
        parts += [Text(""), _boards(rig["boards"])]
    return Group(*parts)


def _boards(boards: Mapping[str, Any]) -> RenderableType:
    made = table("boards", "board", "before", "x", "y", "z", "turned, deg", "sigma", "sigma, deg")
    for name, pose in boards.items():
        made.add_row(escape(name), escape(pose["reference"]), *_cells(pose))
    return made


def _cells(pose: Mapping[str, Any]) -> list[str]:
    """The translation, the angle, and the lengths of the standard deviations of both."""
    angle = float(np.degrees(np.linalg.norm(pose["rotation_vector"])))
    sigmas = [_length(pose[k]) for k in ("sigma_translation", "sigma_rotation_deg")]
    return [*(f"{v:.6g}" for v in pose["translation"]), f"{angle:.5g}", *sigmas]


def _length(sigma: Sequence[float] | None) -> str:
    return "held" if sigma is None else number(float(np.linalg.norm(sigma)), 2)


def _pictures(report: Document) -> RenderableType:
    made = table("pictures by camera", "camera", "used", "of", "points", "rms", "worst")
    for name in report["cameras"]:
        own = [v for v in report["views"] if v.get("camera") == name]
        used = [v for v in own if v["status"] == "used"]
        points = np.array([v["points"] - v["rejected_points"] for v in used])
        squares = np.array([v["rms_point"] or 0.0 for v in used]) ** 2
        rms = float(np.sqrt((points * squares).sum() / max(points.sum(), 1)))
        worst = max(used, key=lambda v: v["rms_point"] or 0.0, default=None)
        said = "-" if worst is None else f"{worst['id']} {number(worst['rms_point'], 3)}"
        made.add_row(
            escape(name), str(len(used)), str(len(own)), str(int(points.sum())), number(rms), escape(said)
        )
    return made
