"""The Kalman filter on the 11 numbers of the projection matrix."""

from __future__ import annotations

from camcal.track import motion
from camcal.track.base import TrackOptions
from camcal.track.matrix_model import MatrixModel
from camcal.track.recursive import Recursive


class Kalman(Recursive):
    """Random walk, or constant velocity, of Column(M).

    The motion is stated in physical terms and carried over to the matrix by its derivative.
    """

    takes = frozenset(("gain", "forgetting", "alpha", "motion", "drift", "velocity"))
    gains = ("kalman", "adaptive", "forgetting", "fixed", "mean")

    def __init__(self, options: TrackOptions):
        noise = motion.figures(options.motion, options.drift)
        super().__init__(options, MatrixModel(), noise, options.gain or self.gains[0])
