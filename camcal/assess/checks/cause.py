"""What all views have in common that one camera does not explain."""

from __future__ import annotations

from collections.abc import Iterator

from camcal.assess.causes.words import warning_of
from camcal.assess.checks.facts import Facts
from camcal.assess.warning import CalibrationWarning


def cause(facts: Facts) -> Iterator[CalibrationWarning]:
    """Zoom, resized pictures, several cameras, a rolling shutter, a stabiliser: see `camcal.assess.causes`."""
    said = warning_of(facts.found) if facts.found is not None else None
    if said is not None:
        yield said
