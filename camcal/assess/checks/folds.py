"""Agreement of the views with each other: whether they determine the same camera."""

from __future__ import annotations

from collections.abc import Iterator

from camcal.assess.checks.facts import Facts
from camcal.assess.warning import CalibrationWarning

#: Ratio of the differences between the cameras of the folds to those due to noise (`fold_difference.py`)
#: above which there is another cause. On simulated data with white noise it is .95 in the median and
#: below 1.7 in all of some hundred runs.
DISAGREE = 2.0

#: Above this ratio, and this median difference of the cameras, px, the sigmas are meaningless: the discrepancy between
#: the views moves the camera by more than a detector's error.
FAR_APART, VISIBLE_PX = 5.0, 0.5


def views_disagree(facts: Facts) -> Iterator[CalibrationWarning]:
    """Cameras from different views differ by more than noise explains."""
    found = (facts.holdout or {}).get("difference")
    if not found or not found["ratio"] > DISAGREE:
        return
    yield CalibrationWarning(
        "views-disagree",
        f"cameras estimated from different views differ {found['ratio']:.1f} times as much as noise explains "
        f"({found['median_px']:.2g} px in the median): multiply the sigmas and the uncertainty by this factor.",
        "Possible causes: a bent or inaccurately printed target (try --board-shape auto, the default for pictures), an "
        "unsuitable lens model, or blurred pictures.",
        "wrong" if found["ratio"] > FAR_APART and found["median_px"] > VISIBLE_PX else "doubtful",
    )
