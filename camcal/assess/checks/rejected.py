"""The amount of rejected data; `camcal.assess.outliers` explains the rejections."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from camcal.assess.checks.facts import Facts
from camcal.assess.warning import CalibrationWarning

#: Share of rejected points above which it is reported: detectors leave one or two in a thousand.
MANY = 0.02

#: if a fifth of the points is wrong, the cause may also have displaced the others
A_FIFTH = 0.2


def many_rejected(facts: Facts) -> Iterator[CalibrationWarning]:
    """A large fraction of the points was rejected."""
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
        "The report lists them with their residuals; check these pictures.",
        "doubtful" if lost.sum() > A_FIFTH * total else "note",
    )
