"""Comparisons read and written: sides from files, gates as checks for CI systems."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from camcal.assess.comparison import Side
from camcal.data.formats.files import recognised
from camcal.data.formats.source import Source
from camcal.report import ci
from camcal.report.ci import Check
from camcal.report.loading import from_document, load_camera
from camcal.report.yaml import read_document

Document = Mapping[str, Any]


def load_side(path: str | os.PathLike) -> Side:
    """A camera to compare: of a camcal report with its uncertainty, of any other camera file without.

    Raises
    ------
    DataError
        Where the file holds no camera.
    """
    file = Path(path)
    if file.is_file() and recognised(source := Source(file)).name == "camcal" and "data" in source.mapping:
        return Side.of(str(path), from_document(read_document(path), str(path)))
    return Side(str(path), load_camera(path))


def checks(comparison: Document) -> list[Check]:
    """The gates of a comparison; one that passes where none was asked for."""
    gates = [
        Check(_title(gate), gate["passed"], sentence(gate), file=comparison["b"]["name"])
        for gate in comparison["gates"]
    ]
    return gates or [Check("comparison", True, file=comparison["b"]["name"])]


def pair(comparison: Document) -> str:
    """What was compared, in words."""
    return f"{comparison['a']['name']} against {comparison['b']['name']}"


def markdown(comparison: Document) -> str:
    """A job summary: the differences of projection, and the gates that fell."""
    header = ("distance", "max px", "rms px", "median px", "max sigma")
    rows = [
        [f"{p['distance']:g}", *("-" if p[k] is None else f"{p[k]:.4g}" for k in _FIGURES)]
        for p in comparison["projection"]
    ]
    return ci.markdown(f"camcal compare: {pair(comparison)}", header, rows, checks(comparison))


_FIGURES = ("max_px", "rms_px", "median_px", "max_sigma")


def _title(gate: Document) -> str:
    return f"{gate['name']} ({gate['unit']})" if gate.get("unit") else gate["name"]


def sentence(gate: Document) -> str:
    """A gate in words: what was found against what was allowed."""
    unit = f" {gate['unit']}" if gate["unit"] else ""
    verdict = "is within" if gate["passed"] else "exceeds"
    return f"{gate['name']}: {gate['value']:.4g}{unit} {verdict} {gate['bound']:g}{unit}"
