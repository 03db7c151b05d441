"""Comparisons read and written: sides from files, gates as checks for CI systems."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from camcal.assess.comparison import Side
from camcal.assess.rig_comparison import RigSide
from camcal.data.formats.files import recognised
from camcal.data.formats.source import Source
from camcal.report import ci
from camcal.report.ci import Check
from camcal.report.loading import from_document, load_camera
from camcal.report.opening import is_rig, load_rig_cameras
from camcal.report.rig_loading import from_document as rig_of
from camcal.report.rig_loading import is_rig_report
from camcal.report.yaml import read_document
from camcal.solve.rig_cameras import within

Document = Mapping[str, Any]


def load_side(path: str | os.PathLike, image_size: tuple[int, int] | None = None) -> Side:
    """A camera to compare: with its uncertainty from a camcal report, without one from any other camera file.

    `image_size` is used if the camera's file does not state it.

    Raises
    ------
    DataError
        If the file holds no camera.
    """
    file = Path(path)
    source = Source(file) if file.is_file() else None
    own = source is not None and recognised(source).name == "camcal"
    if own and source is not None and {"data", "camera"} <= set(source.mapping):
        return Side.of(str(path), from_document(read_document(path), str(path)))
    return Side(str(path), load_camera(path, image_size))


def load_rig_side(path: str | os.PathLike) -> RigSide | None:
    """A rig to compare: with its calibration from a report of `camcal rig`, without from any other file; None for
    a camera.

    Raises
    ------
    DataError
        If the file is missing or damaged.
    """
    if not Path(path).is_file() or not is_rig(path):
        return None
    found = read_document(path) if recognised(Source(Path(path))).name == "camcal" else {}
    if is_rig_report(found):
        solution = rig_of(found, str(path))
        return RigSide(str(path), solution.rig, solution)
    return RigSide(str(path), load_rig_cameras(path))


def side_within(side: RigSide, name: str) -> Side:
    """One camera of a rig."""
    if side.solution is None:
        return Side(f"{side.name}#{name}", side.rig.cameras[name])
    return Side.of(f"{side.name}#{name}", within(side.solution, name))


def checks(comparison: Document) -> list[Check]:
    """The gates of a comparison; a single one that passes if none was requested."""
    gates = [
        Check(_title(gate), gate["passed"], sentence(gate), file=comparison["b"]["name"])
        for gate in comparison["gates"]
    ]
    return gates or [Check("comparison", True, file=comparison["b"]["name"])]


def pair(comparison: Document) -> str:
    """Describe what was compared."""
    return f"{comparison['a']['name']} against {comparison['b']['name']}"


def markdown(comparison: Document) -> str:
    """A job summary: the differences of projection where both cameras have data, and the failed gates."""
    header = ("distance", "max px", "p95 px", "rms px", "max sigma")
    rows = [
        [
            f"{p['distance']:g}",
            *("-" if p["supported"][k] is None else f"{p['supported'][k]:.4g}" for k in _FIGURES),
        ]
        for p in comparison["projection"]
    ]
    return ci.markdown(f"camcal compare: {pair(comparison)}", header, rows, checks(comparison))


_FIGURES = ("max_px", "p95_px", "rms_px", "max_sigma")


def _title(gate: Document) -> str:
    return f"{gate['name']} ({gate['unit']})" if gate.get("unit") else gate["name"]


def sentence(gate: Document) -> str:
    """Describe a gate: the value found and the value allowed."""
    unit = f" {gate['unit']}" if gate["unit"] else ""
    verdict = "is within" if gate["passed"] else "exceeds"
    said = f"{gate['name']}: {gate['value']:.4g}{unit} {verdict} {gate['bound']:g}{unit}"
    if np.isnan(gate["value"]):
        return f"{said}: there is no part of the picture for which both cameras have data"
    place = gate.get("place")
    if gate["passed"] or place is None:
        return said
    where = "largest " if " of projection" in gate["name"] else ""
    return f"{said}, {where}at pixel ({place[0]:.0f}, {place[1]:.0f})"
