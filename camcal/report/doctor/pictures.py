"""Diagnosis of pictures of a target before any calibration."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from camcal.assess.checks.pictures import REMEDIES, faults
from camcal.data.observations import Correspondences
from camcal.errors import CamcalError
from camcal.report.doctor.findings import Finding
from camcal.report.doctor.remedies import lost_pictures
from camcal.system.text import listed

#: least number of pictures: fewer seldom cover the picture, tilts and distances
ENOUGH = 10
#: share of the pictures with a fault above which removing it gains more than further pictures
MANY = 1 / 3


def examine(found: Correspondences) -> list[Finding]:
    """Findings about pictures that were searched for a target."""
    return [*_quality(found), *_count(found)]


def _quality(found: Correspondences) -> Iterator[Finding]:
    for kind, message, share in faults(found):
        yield Finding(f"pictures-{kind}", "better" if share > MANY else "note", message, REMEDIES[kind])


def _count(found: Correspondences) -> Iterator[Finding]:
    if len(found) < ENOUGH:
        yield Finding(
            "few-pictures",
            "better",
            f"the target was found in {len(found)} picture{'' if len(found) == 1 else 's'}.",
            f"Take {ENOUGH} or more: across the whole picture, near and far, tilted by 20 to 45 degrees "
            "in all directions.",
        )


def nothing_found(error: CamcalError, seen: Sequence[Mapping[str, Any]]) -> list[Finding]:
    """The finding if the pictures do not show a common target; `seen` are the events of `detect_images`."""
    reasons = {p["id"]: p["reason"] for p in seen if p["status"] != "found"}
    differ = len(set(reasons.values())) > 1
    reasons_given = f": {listed([f'{k} ({v})' for k, v in reasons.items()])}" if differ else ""
    hint = error.hint or ""
    todo = (
        hint
        if "--" in hint
        else "Specify the target (--board, or --target; `camcal list targets` shows them)."
    )
    return [Finding("no-target", "wrong", f"{error.message.rstrip('.')}{reasons_given}.", todo)]


def not_calibrated(error: CamcalError) -> Finding:
    """The finding if a calibration of the pictures fails."""
    return Finding("not-calibrated", "wrong", error.message, error.hint or "Take more, different pictures.")


def lost(found: Correspondences) -> Iterator[Finding]:
    """The pictures that were not usable."""
    entries = [{"id": v.id, "status": v.status, "reason": v.reason} for v in found.skipped]
    return lost_pictures(len(found), entries)
