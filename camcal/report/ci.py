"""Output for CI systems: JUnit XML, annotations of GitHub workflows, a job summary in Markdown."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

from camcal.errors import UsageError
from camcal.records import dataclass


@dataclass(frozen=True)
class Check:
    """A check that passed or failed.

    Attributes
    ----------
    name : str
    passed : bool
    message : str
        A sentence: what was found against what is allowed.
    kind : str
        The type of the failure for JUnit.
    file : str
        The file that an annotation points to.
    seconds : float
        Duration of the checked work; 0 for a comparison.
    """

    name: str
    passed: bool
    message: str = ""
    kind: str = "tolerance"
    file: str = ""
    seconds: float = 0.0


def junit(command: str, suite: str, checks: Sequence[Check]) -> str:
    """JUnit XML with a test case for each check.

    Parameters
    ----------
    command : str
        Such as `camcal compare`.
    suite : str
        What was checked.
    """
    failures = sum(not check.passed for check in checks)
    counted = {"tests": str(len(checks)), "failures": str(failures), "errors": "0"}
    suites = ElementTree.Element("testsuites", {"name": command, **counted})
    inner = ElementTree.SubElement(suites, "testsuite", {"name": _clean(suite), **counted, "skipped": "0"})
    for check in checks:
        case = {"classname": command.replace(" ", "."), "name": _clean(check.name)}
        case["time"] = f"{check.seconds:.6g}"
        element = ElementTree.SubElement(inner, "testcase", case)
        if not check.passed:
            said = _clean(check.message)
            failure = ElementTree.SubElement(element, "failure", type=check.kind, message=said)
            failure.text = f"{said}\n{_clean(suite)}"
    ElementTree.indent(suites)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(suites, "unicode") + "\n"


def _clean(text: str) -> str:
    """Remove the characters that XML 1.0 does not allow."""
    return "".join(c if c in "\t\n" or (c >= " " and c not in "\ufffe\uffff") else "\ufffd" for c in text)


def github(command: str, checks: Sequence[Check]) -> str:
    """Workflow commands that make annotations on a page of GitHub Actions."""
    lines = []
    for check in checks:
        if not check.message:
            continue
        level = "notice" if check.passed else "error"
        file = f",file={_escaped(check.file, True)}" if check.file and Path(check.file).is_file() else ""
        lines.append(f"::{level} title={command}{file}::{_escaped(check.message)}")
    return "".join(line + "\n" for line in lines)


#: how `--annotations` may be written
ANNOTATIONS = {"github": github}


def _escaped(text: str, inside: bool = False) -> str:
    """Escape for workflow commands: percent signs and line ends; in properties also commas and colons."""
    for character, code in (("%", "%25"), ("\r", "%0D"), ("\n", "%0A")):
        text = text.replace(character, code)
    return text.replace(":", "%3A").replace(",", "%2C") if inside else text


def markdown(
    title: str, header: Sequence[str], rows: Sequence[Sequence[str]], checks: Sequence[Check]
) -> str:
    """A job summary: the verdict, what failed, and a table."""
    failed = [check for check in checks if not check.passed]
    verdict = "passed" if not failed else f"{len(failed)} of {len(checks)} checks failed"
    lines = [f"### {_inline(title)}: {verdict}", ""]
    lines += [f"- **{_inline(check.name)}**: {_inline(check.message)}" for check in failed]
    lines += [""] if failed else []
    lines += [_table_row(header), _table_row(["---"] * len(header)), *map(_table_row, rows), ""]
    return "\n".join(lines) + "\n"


def _table_row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(_inline(cell) if cell != "---" else cell for cell in cells) + " |"


def _inline(text: str) -> str:
    """Escape text for Markdown, on one line."""
    text = " ".join(str(text).split())
    text = text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    for character in "\\`*_[]|#":
        text = text.replace(character, "\\" + character)
    return text


def append_summary(path: str | os.PathLike, text: str) -> None:
    """Append a summary to a file such as $GITHUB_STEP_SUMMARY, to which other steps also append.

    Raises
    ------
    UsageError
        If the file cannot be written.
    """
    try:
        with Path(path).open("a", encoding="utf-8") as stream:
            stream.write(text)
    except OSError as error:
        raise UsageError(
            f"cannot write '{path}': {(error.strerror or str(error)).lower()}.", "Choose another file."
        ) from None
