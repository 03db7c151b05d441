"""A warning: a condition that reduces the value of a result, and its severity."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal

from camcal.records import dataclass

#: `wrong`: do not use the camera, it is off by more than its sigmas say, by several px, or the data are not what they
#: are taken for; `doubtful`: usable, but worse than it looks; `note`: worth knowing
Severity = Literal["note", "doubtful", "wrong"]
SEVERITIES: tuple[Severity, ...] = ("note", "doubtful", "wrong")

#: A check warns where noise alone would look as bad with a probability below this. About ten checks test for it, so
#: that one sound calibration in a thousand gets such a warning.
BY_CHANCE = 1e-4

Grade = Literal["good", "doubtful", "wrong"]


@dataclass(frozen=True)
class CalibrationWarning:
    """A condition that reduces the value of the result; `code` names it for programs."""

    code: str
    message: str
    hint: str = ""
    severity: Severity = "doubtful"


def grade(warnings: Iterable[CalibrationWarning]) -> Grade:
    """The worst severity among warnings; `good` if there are at most notes."""
    return grade_of(w.severity for w in warnings)


def grade_of(severities: Iterable[str]) -> Grade:
    """The worst of some severities; `good` if there are at most notes."""
    found = set(severities)
    return "wrong" if "wrong" in found else "doubtful" if "doubtful" in found else "good"


def warning_entry(warning: CalibrationWarning) -> dict[str, str]:
    """An entry of the report's `warnings`."""
    return {
        "code": warning.code,
        "severity": warning.severity,
        "message": warning.message,
        "hint": warning.hint,
    }
