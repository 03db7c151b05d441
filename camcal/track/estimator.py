"""The interface of estimators, and their output after each frame."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from camcal.errors import UsageError
from camcal.settings.tracking import TrackOptions
from camcal.track.events import Alarm
from camcal.track.frames import Frame
from camcal.track.keep import Kept, stored
from camcal.track.model import Model

Array = np.ndarray


@stored
@dataclass(slots=True)
class TrackState:
    """The estimate after a frame.

    Attributes
    ----------
    frame : int
    status : str
        `waiting` (no estimate yet), `started`, `updated`, `predicted` (too few points), `rejected`
        (the points fit no camera; predicted), `restarted` (after a change).
    estimate : object or None
        The model's own representation; `Model.describe` turns it into K, R, t.
    factor : (p, p) array or None
        L with covariance L Lᵀ in the model's coordinates.
    points, used : int
        Points in the frame, and those that passed the gate.
    innovation : float
        Root mean square distance between the points and where they were predicted, px.
    nis : float
        Normalised innovation squared, of the part that a change of the camera can explain.
    nis_dof : int
    score : float
        `nis` as a standard normal deviate; what the change test adds up.
    cusum : float
    changed : bool
    gain : float
        The fraction of its own correction that the frame was granted, 0 to 1.
    effective : float
        How many frames like this one the estimate is worth.
    noise : float
        Standard deviation of the image points, px (a factor of it where the points bring sigmas).
    alarm : Alarm or None
        What changed, in a frame with `changed`.
    """

    frame: int
    status: str
    estimate: Any = None
    factor: Array | None = None
    points: int = 0
    used: int = 0
    innovation: float = np.nan
    nis: float = np.nan
    nis_dof: int = 0
    score: float = np.nan
    cusum: float = np.nan
    changed: bool = False
    gain: float = np.nan
    effective: float = np.nan
    noise: float = np.nan
    alarm: Alarm | None = None


class Estimator(Kept, ABC):
    """Processes frames in ascending order and returns the camera after each.

    Attributes
    ----------
    model : Model
        Of what the estimates are; None of its parts changes after the first estimate.
    ignored : int
        Frames that were not newer than the one before, in number or time: they change nothing.
    """

    model: Model
    kept: ClassVar[tuple[str, ...]] = ("ignored", "last", "time")
    #: whether the states of `update` are provisional, and those of `finish`, for all frames, final
    offline = False
    #: fields of `TrackOptions` that mean something to it, besides those that mean something to all
    takes: frozenset[str] = frozenset()
    #: gains that the estimator can work with, its own first
    gains: tuple[str, ...] = ()

    def __init__(self, options: TrackOptions):
        self.options = options
        self.ignored = 0
        self.last: int | None = None
        self.time: float | None = None
        if options.gain is not None and options.gain not in self.gains:
            raise UsageError(
                f"this method does not work with the gain '{options.gain}'.",
                f"It takes {', '.join(self.gains)}." if self.gains else "Leave the gain out.",
            )

    def update(self, frame: Frame) -> TrackState | None:
        """Process a frame; return None if it is late or repeated and was ignored."""
        step = self._step(frame)
        if step is None:
            self.ignored += 1
            return None
        self.last, self.time = frame.number, frame.time
        return self._update(frame, step)

    def _step(self, frame: Frame) -> float | None:
        """The number of frames since the last one; None if the frame is not newer."""
        if self.last is None:
            return 1.0
        if frame.number <= self.last:
            return None
        if frame.time is None or self.time is None:
            return float(frame.number - self.last)
        return (frame.time - self.time) * self.options.rate if frame.time > self.time else None

    @abstractmethod
    def _update(self, frame: Frame, step: float) -> TrackState:
        """Process a frame that is `step` frames after the previous one."""

    def finish(self) -> Iterable[TrackState]:
        """Return the states that were held back until the end of the stream, in order."""
        return ()
