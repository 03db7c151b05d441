"""cv2.stereoCalibrate on the pairs of cameras of a rig."""

from __future__ import annotations

from camcal.peers.base import Entry
from camcal.solve.calibration import Estimate, RigCalibration
from camcal.solve.refine import How


def crosscheck(solution: RigCalibration, flat: Estimate | None, how: How) -> tuple[Entry, ...]:
    """Compare each pair of cameras with cv2."""
    return ()
