"""Films: detection of a rolling shutter, which reads the rows of a frame sequentially while the target moves."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from camcal.assess.causes.words import severity
from camcal.assess.checks.facts import Facts
from camcal.assess.rolling import Readout, effect_px, sure
from camcal.assess.warning import CalibrationWarning

STILL = (
    "Hold the target still for a moment in each position (frames without motion are preferred), put "
    "camera and target on "
    "stands, or use a global shutter."
)


def rolling_shutter(facts: Facts) -> Iterator[CalibrationWarning]:
    """The residuals of a film are proportional to row times speed of the target, and the points are not corrected."""
    found = sure(facts.solution)
    if found is None:
        return
    effect = effect_px(facts.solution, found)
    # a board of free shape absorbed most of a readout of .8 frames: .12 remained
    shaped = facts.solution.board is not None
    rest = " The estimated shape of the board absorbs the rest." if shaped else ""
    yield CalibrationWarning(
        "rolling-shutter",
        f"{_words(found, 'at least ' * shaped)} The camera is off by {effect:.2g} px (rms over the picture).{rest}",
        ("Measure the time with --board-shape flat. " if shaped else "") + STILL,
        severity(effect, 0.0, False, float(np.sqrt(1 - found.share))),
    )


def corrected_for(found: Readout, effect: float) -> CalibrationWarning:
    """The warning that points were corrected for a readout time; `effect`, px, is the camera's error without it."""
    return CalibrationWarning(
        "rolling-shutter",
        f"{_words(found)} Without a correction the camera would be off by {effect:.2g} px (rms over the "
        f"picture): the points were moved to their positions at the time when the first row was read.",
        f"The motion between frames is known only approximately. {STILL}",
        "doubtful" if severity(effect, 0.0, False, 1.0) != "note" else "note",
    )


def _words(found: Readout, least: str = "") -> str:
    order = "" if found.time > 0 else ", the last row first"
    return (
        f"the residuals follow the row times the speed of the target: rows are read one after the other{order}, all "
        f"within {least}{abs(found.time):.2f} +- {found.sigma:.2f} of the time from frame to frame, which displaces "
        f"points by up to {found.most:.2g} px. It explains {found.share:.0%} of the squared residuals."
    )
