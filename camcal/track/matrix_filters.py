"""The estimators on the 11 entries of the projection matrix: `kalman`, `rls` and `batch`."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from camcal.settings.tracking import TrackOptions
from camcal.start import central
from camcal.track import linear, motion
from camcal.track.estimator import TrackState
from camcal.track.frames import Frame
from camcal.track.matrix_model import MatrixModel
from camcal.track.recursive import Recursive

Array = np.ndarray


class Kalman(Recursive):
    """Kalman filter: random walk, or constant velocity, of Column(M).

    The motion is stated in physical terms and carried over to the matrix by its derivative.
    """

    takes = frozenset(("gain", "forgetting", "alpha", "motion", "drift", "velocity"))
    gains = ("kalman", "adaptive", "forgetting", "fixed", "mean")

    def __init__(self, options: TrackOptions):
        noise = motion.figures(options.motion, options.drift)
        super().__init__(options, MatrixModel(), noise, options.gain or self.gains[0])


class RecursiveLeastSquares(Recursive):
    """Weighted least squares over all frames so far; the weight of a frame decreases with its age.

    It knows no motion: what follows a moving camera is the forgetting, and the covariance is that of the
    noise alone, without the lag behind a camera that moves.
    """

    gains = ("forgetting", "fixed", "mean", "adaptive")
    takes = frozenset(("gain", "forgetting", "alpha"))

    def __init__(self, options: TrackOptions):
        super().__init__(options, MatrixModel(), motion.NONE, options.gain or self.gains[0])


class Batch(Recursive):
    """Each frame separately: Column(M) = Central⁺ Column(Y) (Barranco & Medel, eq. 4) in normalised coordinates.

    The estimates have no memory. What has one is the reference against which points are gated and changes
    tested: the mean over all frames since the start or the last change.
    """

    kept: ClassVar[tuple[str, ...]] = ("own",)

    def __init__(self, options: TrackOptions):
        self.model: MatrixModel
        super().__init__(options, MatrixModel(), motion.NONE, "mean")
        self.own: list[Array] | None = None

    def _report(self, frame: Frame, status: str, keep: Array | None = None, **more: Any) -> TrackState:
        """Report the frame's own estimate instead of the reference; a frame without one keeps the last."""
        state = super()._report(frame, status, keep, **more)
        if keep is not None and np.count_nonzero(keep) >= self.model.start_points:
            self.own = self._theorem(frame, keep)
            state.gain = state.effective = 1.0
        elif self.own is None:
            self.own = [self.x, self.factor]
        state.estimate, state.factor = self.own
        return state

    def _theorem(self, frame: Frame, keep: Array) -> list[Array]:
        """The estimate (11,) and the factor of its covariance.

        The error of a row of Central is the pixel's times the depth of the point, so that the
        covariance is that of least squares whose weights are not those of the noise.
        """
        xyz, uv = self.model.normalise(frame, keep)
        matrix, _ = central.projection_matrix(xyz, uv)
        depth = np.abs(xyz @ matrix[2, :3] + 1.0)
        noise = self.noise.sigma * self.model.per_pixel * depth
        if frame.sigma is not None:
            noise = noise * frame.sigma[keep]
        inverse = np.linalg.pinv(central.Central(xyz, uv))
        return [matrix.reshape(12)[:11], linear.triangle(inverse * np.repeat(noise, 2))]
