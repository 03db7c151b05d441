"""What pictures of a target show to be wrong before anything is calibrated."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from camcal.errors import CamcalError
from camcal.report.doctor.findings import Finding
from camcal.report.doctor.remedies import listed, lost_pictures
from camcal.types import Correspondences

#: what to do about a picture, by the first word of what `targets/quality.py` says of it
REMEDIES = {
    "blurred": "Focus on the target's distance, and keep the focus fixed; a smaller aperture helps.",
    "motion": "Put target or camera on a stand, or expose shorter with more light.",
    "overexposed": "Less light or a shorter exposure: white paper must not reach full scale.",
    "flat": "More light, and a target in true black and white.",
    "rough": "More light (less gain), no compression, a target without texture or glare.",
    "small": "Come nearer: a target that fills half the picture tells most.",
}
#: fewer pictures than this seldom cover picture, tilts and distances
ENOUGH = 10


def examine(found: Correspondences) -> list[Finding]:
    """Findings on pictures in which a target was looked for."""
    return [*_quality(found), *_count(found)]


def _quality(found: Correspondences) -> Iterator[Finding]:
    by_kind: dict[str, list[str]] = {}
    used = {v.id for v in found.views}
    for name, measured in found.picture_quality.items():
        for said in measured.get("warnings") or []:
            if name in used:
                by_kind.setdefault(said.partition(":")[0], []).append(f"{name} ({said.partition(': ')[2]})")
    for kind, pictures in by_kind.items():
        many = len(pictures) > len(used) / 3
        yield Finding(
            f"pictures-{kind}",
            "better" if many else "note",
            f"{kind} in {len(pictures)} of {len(used)} pictures: {listed(pictures, 3)}.",
            REMEDIES.get(kind, "Take them again."),
        )


def _count(found: Correspondences) -> Iterator[Finding]:
    if len(found) < ENOUGH:
        yield Finding(
            "few-pictures",
            "better",
            f"the target was found in {len(found)} picture{'' if len(found) == 1 else 's'}.",
            f"Take {ENOUGH} or more: all over the picture, near and far, tilted by 20 to 45 degrees to all sides.",
        )


def nothing_found(error: CamcalError, seen: Sequence[Mapping[str, Any]]) -> list[Finding]:
    """The finding where the pictures do not show one target; `seen` are the events of `detect_images`."""
    reasons = {p["id"]: p["reason"] for p in seen if p["status"] != "found"}
    differ = len(set(reasons.values())) > 1
    told = f": {listed([f'{k} ({v})' for k, v in reasons.items()])}" if differ else ""
    hint = error.hint or ""
    todo = (
        hint if "--" in hint else "Name the target (--board, or --target; `camcal list targets` shows them)."
    )
    return [Finding("no-target", "wrong", f"{error.message.rstrip('.')}{told}.", todo)]


def not_calibrated(error: CamcalError) -> Finding:
    """The finding where a calibration of the pictures fails."""
    return Finding("not-calibrated", "wrong", error.message, error.hint or "Take more and other pictures.")


def lost(found: Correspondences) -> Iterator[Finding]:
    """The pictures that were of no use."""
    entries = [{"id": v.id, "status": v.status, "reason": v.reason} for v in found.skipped]
    return lost_pictures(len(found), entries)
