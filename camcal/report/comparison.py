"""Comparisons read and written: sides from files, JUnit XML and annotations for CI jobs."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from camcal.assess.comparison import Side
from camcal.data.formats.files import recognised
from camcal.data.formats.source import Source
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


def junit(comparison: Document) -> str:
    """The gates as JUnit XML: a test case each, or one for the comparison itself where none was asked for."""
    pair = f"{comparison['a']['name']} against {comparison['b']['name']}"
    gates = comparison["gates"]
    fallen = [g for g in gates if not g["passed"]]
    suites = ElementTree.Element(
        "testsuites",
        name="camcal compare",
        tests=str(max(len(gates), 1)),
        failures=str(len(fallen)),
        errors="0",
    )
    suite = ElementTree.SubElement(suites, "testsuite", {**suites.attrib, "name": pair, "skipped": "0"})
    for gate in gates or [{"name": "comparison", "passed": True}]:
        case = ElementTree.SubElement(
            suite, "testcase", classname="camcal.compare", name=_title(gate), time="0"
        )
        if not gate["passed"]:
            failure = ElementTree.SubElement(case, "failure", type="tolerance", message=sentence(gate))
            failure.text = f"{sentence(gate)}\n{pair}"
    ElementTree.indent(suites)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(suites, "unicode") + "\n"


def _title(gate: Document) -> str:
    return f"{gate['name']} ({gate['unit']})" if gate.get("unit") else gate["name"]


def sentence(gate: Document) -> str:
    """A gate in words: what was found against what was allowed."""
    unit = f" {gate['unit']}" if gate["unit"] else ""
    verdict = "is within" if gate["passed"] else "exceeds"
    return f"{gate['name']}: {gate['value']:.4g}{unit} {verdict} {gate['bound']:g}{unit}"


def github(comparison: Document) -> str:
    """Workflow commands that make annotations of the gates on a page of GitHub Actions."""
    name = comparison["b"]["name"]
    file = f",file={_escaped(name, True)}" if Path(name).is_file() else ""
    lines = []
    for gate in comparison["gates"]:
        level = "notice" if gate["passed"] else "error"
        lines.append(f"::{level} title=camcal compare{file}::{_escaped(sentence(gate))}")
    return "".join(line + "\n" for line in lines)


def _escaped(text: str, inside: bool = False) -> str:
    """As the workflow commands want it: percent signs and line ends; in properties commas and colons too."""
    for character, code in (("%", "%25"), ("\r", "%0D"), ("\n", "%0A")):
        text = text.replace(character, code)
    return text.replace(":", "%3A").replace(",", "%2C") if inside else text


#: how `--annotations` may be written
ANNOTATIONS = {"github": github}
