"""A finding: the problem, the remedy, and its gain; and the order of findings."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import Any, Literal

from camcal.records import dataclass
from camcal.report.charts.base import short

SCHEMA = "camcal-doctor/1"
#: `wrong`: do not use the result; `better`: usable, but can be improved; `note`: for information
Grade = Literal["wrong", "better", "note"]
GRADES: tuple[Grade, ...] = ("wrong", "better", "note")


@dataclass(frozen=True)
class Gain:
    """The predicted gain of a remedy: a figure that becomes smaller.

    Attributes
    ----------
    figure : str
        The figure that decreases, with its unit.
    now, after : float
    how : str
        The basis of the prediction.
    at_most : bool
        Whether the gain is reached only if the remedy removes the entire cause.
    """

    figure: str
    now: float
    after: float
    how: str
    at_most: bool = False

    @property
    def times(self) -> float:
        """The factor by which the figure decreases."""
        return self.now / self.after if self.after > 0 else math.inf

    @property
    def words(self) -> str:
        """The gain in a line."""
        limit = "at best " if self.at_most else ""
        return f"{self.figure}: from {short(self.now)} to {limit}{short(self.after)} ({self.how})"


@dataclass(frozen=True)
class Finding:
    """A problem, or a possible improvement.

    Attributes
    ----------
    code : str
        Identifier for programs; for a warning, its code.
    grade : Grade
    message : str
        What was found.
    todo : str
        What to do next.
    gain : Gain, optional
    """

    code: str
    grade: Grade
    message: str
    todo: str
    gain: Gain | None = None


def ordered(findings: Iterable[Finding]) -> list[Finding]:
    """Sort findings: the worst grade first; within a grade the largest gain first, then those with unknown gain."""

    def key(finding: Finding) -> tuple[int, float]:
        return GRADES.index(finding.grade), -(finding.gain.times if finding.gain else 0.0)

    return sorted(findings, key=key)


def diagnosis(about: str, sentence: str, findings: Sequence[Finding], **more: Any) -> dict[str, Any]:
    """The document of `camcal doctor`; `healthy` is false if something is wrong."""
    found = ordered(findings)
    return {
        "schema": SCHEMA,
        "about": about,
        "healthy": all(f.grade != "wrong" for f in found),
        "sentence": sentence,
        "findings": [_entry(f) for f in found],
        **more,
    }


def _entry(finding: Finding) -> dict[str, Any]:
    made = asdict(finding)
    if finding.gain is not None:
        made["gain"] |= {"times": finding.gain.times}
    return made
