"""Bundle adjustment over a sliding window of frames."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from camcal.errors import UsageError
from camcal.settings.tracking import TrackOptions
from camcal.track import linear, robust
from camcal.track.frames import Frame
from camcal.track.gains import kalman
from camcal.track.iekf import IteratedKalman
from camcal.track.keep import stored
from camcal.track.reading import Reading, Verdict, innovation_factor, whitened_rows

Array = np.ndarray

SETTLED = (
    1e-2  #: standard deviations of one frame; a smaller step, anywhere in the window, ends the iterations
)


@stored
@dataclass(slots=True)
class WindowFrame:
    """A frame in the window: its kept points, the noise of the step to it, and its camera after the last
    adjustment.
    """

    frame: Frame
    keep: Array
    whitening: Any
    noise: Array
    x: Any


class Window(IteratedKalman):
    """Adjusts all cameras of the last frames together, linked by the motion, at each new frame.

    Gauss-Newton on the sum of the squared residuals of all frames in the window, of the steps between them,
    and of what the frames that have left it say about the oldest. Each iteration is a Kalman filter forward
    and a Rauch-Tung-Striebel pass backward, linearised at the trajectory of the iteration before: the same
    thing (Bell, SIAM J. Optimization 4, 1994) at a cost in proportion to the number of frames. A frame that
    leaves the window is marginalised at its last linearisation.
    """

    gains = ("kalman",)
    takes = IteratedKalman.takes - {"alpha", "velocity"} | {"window"}
    kept: ClassVar[tuple[str, ...]] = ("entries", "anchor", "anchor_factor", "_since_anchor")

    def __init__(self, options: TrackOptions):
        if options.velocity:
            raise UsageError(
                "the method 'window' does not track a velocity.", "Use --method iekf or smoother."
            )
        super().__init__(options)
        self.entries: list[WindowFrame] = []
        self.anchor: Any = None
        self.anchor_factor = np.zeros((0, 0))
        self._since_anchor = np.zeros((0, 0))

    def _adopt(self, found: robust.FrameFit) -> None:
        super()._adopt(found)
        self.entries = []
        self.anchor, self.anchor_factor = self.x, self.factor
        self._since_anchor = np.zeros((self.model.size, 0))

    def _predict(self, step: float) -> None:
        super()._predict(step)
        self._since_anchor = np.hstack([self._since_anchor, self._pushed])

    def _correct(self, frame: Frame, reading: Reading, verdict: Verdict, step: float) -> float:
        """Add the frame and adjust the window; see `Recursive._correct`."""
        self.entries.append(WindowFrame(frame, reading.keep, reading.whitening, self._since_anchor, self.x))
        self._since_anchor = np.zeros((self.model.size, 0))
        granted = 0.0
        for _ in range(self.iterations):
            granted, largest = self._adjust()
            if largest < SETTLED:
                break
        if len(self.entries) > self.options.window:
            oldest = self.entries.pop(0)
            self.anchor, self.anchor_factor = self._forward(self.anchor, self.anchor_factor, oldest)[:2]
        return granted

    def _forward(self, x: Any, factor: Array, entry: WindowFrame) -> tuple[Any, Array, Array, Array, Array]:
        """Predict and correct by one frame, linearised at the frame's camera in the last adjustment.

        Returns
        -------
        x, factor : the corrected camera
        predicted : (p, p) array, the factor before the correction
        a, gain : (p, p) arrays
        """
        predicted = linear.triangle(np.hstack([factor, entry.noise])) if entry.noise.size else factor
        design, valid = self.model.linearise(entry.x, entry.frame)
        a, z = linear.compress(whitened_rows(design, entry.keep & valid, entry.whitening))[:2]
        gain = kalman(predicted, a, innovation_factor(a, predicted))
        x = self.model.retract(x, gain @ (z + a @ self.model.local(x, entry.x)))
        return x, linear.joseph(gain, a, predicted), predicted, a, gain

    def _adjust(self) -> tuple[float, float]:
        """One iteration; return the gain of the newest frame and the largest move, in its standard deviations."""
        x, factor = self.anchor, self.anchor_factor
        passes = []
        for entry in self.entries:
            before = x
            x, factor, predicted, a, gain = self._forward(x, factor, entry)
            passes.append((before, x, factor, predicted))
        self.x, self.factor = x, factor
        smooth, largest = x, 0.0
        for index in range(len(self.entries) - 1, -1, -1):
            entry = self.entries[index]
            moved = a @ self.model.local(entry.x, smooth)  # the newest frame's measure serves for all
            largest = max(largest, float(np.abs(moved).max()))
            entry.x = smooth
            if index:
                _, filtered, own, _ = passes[index - 1]
                before, _, _, predicted = passes[index]
                error = linear.solve_factored(predicted, self.model.local(before, smooth))
                smooth = self.model.retract(filtered, own @ (own.T @ error))
        return float(np.einsum("ij,ji->", a, gain)) / len(a), largest
