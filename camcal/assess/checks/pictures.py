"""The pictures: blurred, moved, overexposed, of low contrast, uneven, or with a small target."""

from __future__ import annotations

from collections.abc import Iterator

from camcal.assess.checks.facts import Facts
from camcal.assess.warning import CalibrationWarning
from camcal.data.observations import Correspondences

#: what to do about a picture, by the first word of what `targets/quality.py` says of it
REMEDIES = {
    "blurred": "Focus at the target's distance, and keep the focus fixed; a smaller aperture helps.",
    "motion": "Mount the target or the camera on a stand, or use a shorter exposure with more light.",
    "overexposed": "Use less light or a shorter exposure: white paper must not saturate.",
    "flat": "Use more light, and a target in true black and white.",
    "rough": "Use more light (less gain), no compression, and a target without texture or glare.",
    "small": "Move closer: a target that fills half the picture is most informative.",
}
#: pictures that are named one by one
NAMED = 3


def poor_pictures(facts: Facts) -> Iterator[CalibrationWarning]:
    """Used pictures of avoidably low quality, one warning per fault."""
    for kind, message, _ in faults(facts.solution.observations):
        yield CalibrationWarning(f"pictures-{kind}", message, REMEDIES[kind], "note")


def faults(correspondences: Correspondences) -> Iterator[tuple[str, str, float]]:
    """Each fault of the used pictures: its kind, its description, and the fraction of the pictures with it."""
    by_kind: dict[str, list[str]] = {}
    used = [v.id for v in correspondences.views]
    for name in used:
        for said in correspondences.picture_quality.get(name, {}).get("warnings") or []:
            kind, _, words = said.partition(": ")
            by_kind.setdefault(kind, []).append(f"{name} ({words})")
    for kind, pictures in by_kind.items():
        named = ", ".join(pictures[:NAMED]) + (", ..." if len(pictures) > NAMED else ".")
        yield kind, f"{kind} in {len(pictures)} of {len(used)} pictures: {named}", len(pictures) / len(used)
