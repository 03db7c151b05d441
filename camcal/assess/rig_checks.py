"""Conditions that make the calibration of a rig less than it seems."""

from __future__ import annotations

from camcal.assess.warning import CalibrationWarning
from camcal.solve.calibration import RigCalibration
from camcal.solve.rig_start import Pictures


def check(solution: RigCalibration, pictures: Pictures) -> tuple[CalibrationWarning, ...]:
    """All warnings on a rig."""
    found = []
    if not solution.fit.converged:
        found.append(
            CalibrationWarning(
                "not-converged",
                f"the joint refinement did not converge: {solution.fit.stop_reason}.",
                "Look at the residuals of the cameras; leave out pictures that do not belong.",
            )
        )
    return tuple(found)
