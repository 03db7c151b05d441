"""A warning: something that makes a result less than it seems."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class CalibrationWarning:
    """Something that makes the result less than it seems; `code` names it for programs."""

    code: str
    message: str
    hint: str = ""
