"""How much was rejected; `camcal.assess.outliers` says what it is."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from camcal.assess.checks.facts import Facts
from camcal.assess.warning import CalibrationWarning

#: Share of rejected points from which on it is worth a word: detectors leave a point or two in a thousand.
MANY = 0.02


def many_rejected(facts: Facts) -> Iterator[CalibrationWarning]:
    """A good part of the points is wrong."""
    data = facts.solution.observations
    total, counts = data.point_count, data.blocks.counts
    lost = data.per_block(~data.used).astype(int)
    if not total or lost.sum() <= MANY * total:
        return
    worst = np.argsort(-lost)[:3]
    named = ", ".join(f"{facts.views[i].id} ({lost[i]} of {counts[i]})" for i in worst if lost[i])
    yield CalibrationWarning(
        "rejected-points",
        f"{lost.sum()} of {total} points ({lost.sum() / total:.1%}) were rejected as outliers, most of them in "
        f"{named}.",
        "The report lists them with their residuals; look at these pictures.",
    )
