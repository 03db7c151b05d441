"""The board: residuals that repeat at the same points of it in all views."""

from __future__ import annotations

from collections.abc import Iterator

from camcal.assess.checks.facts import Facts
from camcal.assess.warning import BY_CHANCE, CalibrationWarning

#: A non-ideal board is reported if it reduces sigma_hat below this fraction, and if a flat board would do so with a
#: probability below `BY_CHANCE`.
GAIN = 0.85


def not_flat(facts: Facts) -> Iterator[CalibrationWarning]:
    """The board's shape clearly differs from the assumed one."""
    found = facts.free_board
    if found is None or found.p_value > BY_CHANCE or found.after > GAIN * found.before:
        return
    target = facts.solution.observations.target or {}
    offset = found.rms_offset / float(target.get("square") or 1.0)
    unit = "squares" if target.get("square") else "(unit of the points)"
    yield CalibrationWarning(
        "board-not-flat",
        f"the residuals repeat at the same points of the board: with points {offset:.2g} {unit} off their "
        f"places sigma_hat would fall from {found.before:.3g} to {found.after:.3g} px.",
        "Let camcal estimate the board's shape (--board-shape auto, the default for pictures); if it did, mount the "
        "board on glass or another flat plate.",
    )
