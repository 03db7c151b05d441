"""The Rauch-Tung-Striebel smoother: each frame's camera from earlier and later frames, off-line."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from camcal.settings.tracking import TrackOptions
from camcal.track import linear
from camcal.track.estimator import TrackState
from camcal.track.frames import Frame
from camcal.track.iekf import IteratedKalman

Array = np.ndarray


class Smoother(IteratedKalman):
    """The iterated extended Kalman filter forward, then once backward.

    Rauch, Tung & Striebel, AIAA Journal 3 (1965). The covariance goes backward in Joseph's form,
    P = (I - C F) P (I - C F)ᵀ + C Q Cᵀ + C P⁺ Cᵀ, so that it stays positive. No information passes a change:
    what lies before it is smoothed on its own.

    Memory grows with the number of frames.
    """

    gains = ("kalman",)
    takes = IteratedKalman.takes - {"alpha"}
    offline = True
    kept: ClassVar[tuple[str, ...]] = ("steps", "states")

    def __init__(self, options: TrackOptions):
        super().__init__(options)
        self.states: list[TrackState] = []
        self.steps: list[dict[str, Any]] = []

    def _update(self, frame: Frame, step: float) -> TrackState:
        before = None if self.x is None else self.factor
        state = super()._update(frame, step)
        linked = before is not None and state.status != "restarted"
        self.steps.append(
            {
                "linked": linked,
                "step": step,
                "noise": self._pushed if linked else None,
                "predicted": self.predicted if linked else None,
                "x": self.x,
                "factor": self.factor,
                "velocity": self.velocity,
            }
        )
        self.states.append(state)
        return state

    def _predict(self, step: float) -> None:
        super()._predict(step)
        self.predicted = {
            "x": self.x,
            "factor": self.factor,
            "velocity": self.velocity,
        }

    def finish(self) -> list[TrackState]:
        """Return all frames, smoothed."""
        super().finish()
        after: tuple[Any, Array, Array | None] | None = None
        for state, own, later in zip(
            self.states[::-1], self.steps[::-1], [None, *self.steps[:0:-1]], strict=True
        ):
            if own["x"] is None:
                break
            here = own["x"], own["factor"], own["velocity"]
            if later is not None and later["linked"] and after is not None:
                here = self._back(here, later, after)
            after = here
            state.estimate, state.factor = here[0], here[1][: self.model.size]
        return self.states

    def _back(
        self,
        here: tuple[Any, Array, Array | None],
        later: dict[str, Any],
        after: tuple[Any, Array, Array | None],
    ) -> tuple[Any, Array, Array | None]:
        """One step backward: the filter's camera here, the step to the next frame, and that frame smoothed."""
        x, factor, velocity = here
        p, n = self.model.size, len(factor)
        forward = np.eye(n)
        if velocity is not None:
            forward[:p, p:] = later["step"] * np.eye(p)
        predicted = later["predicted"]
        inverse = _scaled_inverse(predicted["factor"])
        back = factor @ (forward @ factor).T @ inverse.T @ inverse
        error = self.model.local(predicted["x"], after[0])
        if velocity is not None:
            error = np.concatenate([error, after[2] - predicted["velocity"]])
        delta = back @ error
        rows = np.hstack([factor - back @ (forward @ factor), back @ later["noise"], back @ after[1]])
        return (
            self.model.retract(x, delta[:p]),
            linear.triangle(rows),
            None if velocity is None else velocity + delta[p:],
        )


def _scaled_inverse(factor: Array) -> Array:
    """The pseudo-inverse of L, with rows scaled to unit length; velocities may have no variance."""
    size = np.linalg.norm(factor, axis=1)
    scale = np.where(size > 0, 1 / np.where(size > 0, size, 1.0), 0.0)
    return np.linalg.pinv(factor * scale[:, None], rcond=linear.UNDETERMINED) * scale
