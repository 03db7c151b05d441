"""Recursive least squares with a forgetting factor on Central and Column."""

from __future__ import annotations

from camcal.track.base import TrackOptions
from camcal.track.matrix_model import MatrixModel
from camcal.track.motion import GROUPS
from camcal.track.recursive import Recursive


class RecursiveLeastSquares(Recursive):
    """Weighted least squares over all frames so far, the weight of a frame falling with its age.

    It knows no motion: what follows a moving camera is the forgetting, and the covariance is that of the
    noise alone, without the lag behind a camera that moves.
    """

    gains = ("forgetting", "fixed", "mean", "adaptive")
    takes = frozenset(("gain", "forgetting", "alpha"))

    def __init__(self, options: TrackOptions):
        super().__init__(options, MatrixModel(), dict.fromkeys(GROUPS, 0.0), options.gain or self.gains[0])
