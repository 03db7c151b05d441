"""Diagnosis of a calibration from its report."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from camcal.plan.solution import Solution
from camcal.report import words
from camcal.report.doctor import remedies
from camcal.report.doctor.findings import Finding, Gain, Grade, diagnosis, ordered

Document = Mapping[str, Any]

#: the grade of a finding, by the severity of its warning
_GRADES: dict[str, Grade] = {"wrong": "wrong", "doubtful": "better", "note": "note"}
#: warnings that additional suitable pictures remove
_PICTURES = frozenset(
    (
        "single-view",
        "few-views",
        "few-points",
        "fronto-parallel-views",
        "parallel-views",
        "duplicate-views",
        "poor-coverage",
        "undetermined-parameters",
        "weak-parameters",
        "weak-geometry",
        "correlated-parameters",
    )
)


def examine(report: Document, solution: Solution, source: str, try_models: bool = True) -> list[Finding]:
    """All findings about a calibration, in order.

    Parameters
    ----------
    report : dict
        The document.
    solution : Solution
        The same.
    source : str
        Name of the report in the suggested commands; empty if there is none yet.
    try_models : bool
        Whether other lens models are fitted if the residuals suggest one, which takes seconds.
    """
    pictures, board = remedies.next_views(solution, source), remedies.board_shape(solution)
    model = remedies.lens_model(solution, report, board) if try_models else None
    # findings of equal gain keep this order: where to hold the target before the warnings that this resolves
    found = [f for f in (pictures, model, remedies.worse_views(solution, report)) if f]
    found += [*gates(report), *warnings(report, pictures, board), *lost(report)]
    if board and not any(f.code == board.code for f in found):
        found.append(board)
    biased = remedies.bias(report)
    if biased and not (board or model):  # these state the cause
        found.append(biased)
    return ordered(found)


def gates(report: Document) -> Iterator[Finding]:
    """Findings for failed gates."""
    for failure in report.get("failures", []):
        if failure.startswith("graded "):
            continue  # that warning is a separate finding
        yield Finding(
            "gate",
            "wrong",
            f"{failure}.",
            "See `crosscheck` in the report for OpenCV's result."
            if "cross-check" in failure
            else "The findings below say how to reduce it.",
        )


def lost(report: Document) -> Iterator[Finding]:
    """A finding for unused pictures."""
    views = report["views"]
    unused = [v for v in views if v["status"] != "used"]
    return remedies.lost_pictures(len(views) - len(unused), unused)


def warnings(report: Document, pictures: Finding | None, board: Finding | None) -> Iterator[Finding]:
    """The report's warnings, each with the gain of its remedy."""
    for warning in report["warnings"]:
        code = warning["code"]
        gain: Gain | None = None
        if code in _PICTURES and pictures:
            gain = pictures.gain
        elif board and code == board.code:
            yield replace(board, message=warning["message"])
            continue
        elif code == "views-disagree":
            gain = _agreement(report)
        grade = _GRADES[warning["severity"]]
        yield Finding(code, grade, warning["message"], warning["hint"], gain)


def _agreement(report: Document) -> Gain | None:
    difference = (report.get("holdout") or {}).get("difference")
    if not difference:
        return None
    return Gain(
        "differences relative to noise",
        difference["ratio"],
        1.0,
        "if the cause were removed completely",
        True,
    )


def sentence(report: Document, findings: list[Finding]) -> str:
    """The diagnosis in a sentence or two."""
    wrong = [f for f in findings if f.grade == "wrong"]
    trust = words.trust(report)
    if wrong:
        return f"Do not use this calibration as it is: {wrong[0].message}"
    better = [f for f in findings if f.grade == "better"]
    if not better:
        return f"Nothing is wrong with this calibration. {trust}".rstrip()
    gaining = [f for f in better if f.gain]
    first = gaining[0] if gaining else better[0]
    return f"This calibration can be used, but it can be improved: {first.message} {trust}".rstrip()


def diagnose(report: Document, solution: Solution, source: str) -> dict[str, Any]:
    """The document about a calibration."""
    found = examine(report, solution, source)
    return diagnosis("calibration", sentence(report, found), found, source=source)
