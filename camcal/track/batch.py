"""Each frame alone: the estimator of Barranco & Medel, without memory."""

from __future__ import annotations

from typing import Any

import numpy as np

from camcal.start import central
from camcal.track import linear
from camcal.track.base import Frame, State, TrackOptions
from camcal.track.matrix_model import MatrixModel
from camcal.track.motion import GROUPS
from camcal.track.reading import Reading, Verdict
from camcal.track.recursive import Recursive

Array = np.ndarray


class Batch(Recursive):
    """Column(M) = Central⁺ Column(Y) of every frame (their theorem, eq. 4), on normalised coordinates.

    The estimates have no memory. What has one is the reference against which points are gated and changes
    tested: the mean over all frames since the start or the last change.
    """

    def __init__(self, options: TrackOptions):
        self.model: MatrixModel
        super().__init__(options, MatrixModel(), dict.fromkeys(GROUPS, 0.0), "mean")
        self.own: tuple[Array, Array] | None = None

    def _report(
        self,
        frame: Frame,
        status: str,
        keep: Array | None = None,
        reading: Reading | None = None,
        verdict: Verdict | None = None,
        gain: float = 0.0,
        a: Array | None = None,
    ) -> State:
        """Tell the frame's own estimate in place of the reference; a frame without keeps the last one's."""
        state = super()._report(frame, status, keep, reading, verdict, gain, a)
        if keep is not None and np.count_nonzero(keep) >= self.model.start_points:
            self.own = self._theorem(frame, keep)
            state.gain = state.effective = 1.0
        elif self.own is None:
            self.own = self.x, self.factor
        state.estimate, state.factor = self.own
        return state

    def _theorem(self, frame: Frame, keep: Array) -> tuple[Array, Array]:
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
        return matrix.reshape(12)[:11], linear.triangle(inverse * np.repeat(noise, 2))

    def state(self) -> dict[str, Any]:
        """With the last estimate."""
        return {**super().state(), "own": None if self.own is None else list(self.own)}

    def restore(self, state: Any) -> None:
        """See `Estimator.restore`."""
        super().restore(state)
        self.own = None if state["own"] is None else tuple(state["own"])
