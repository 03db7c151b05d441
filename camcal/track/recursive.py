"""The recursion that the filters share: predict, gate, test, correct; restart after a change."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from camcal.errors import CamcalError, DataError, EstimationError, UsageError
from camcal.registry import look_up
from camcal.settings.tracking import TrackOptions
from camcal.track import GAINS, first, linear, motion, noise, robust
from camcal.track.detection import LARGEST, ChangeTest, normal_deviate
from camcal.track.estimator import Estimator, TrackState
from camcal.track.events import Alarm
from camcal.track.frames import Frame, join
from camcal.track.model import Model
from camcal.track.noise import Noise
from camcal.track.reading import Reading, Verdict, innovation_factor, near_prediction, whitened_rows

Array = np.ndarray

#: frames that are waited for points which determine a camera
PATIENCE = 10
#: with a smaller part of the points near their prediction it is the camera that is off, not the points
MAJORITY = 0.6
#: but where the frame's own camera explains hardly more points than the prediction does, the others are outliers
SAME = 0.9
#: a frame whose points disagree with each other, whatever the camera, more than one frame in so many does: it
#: may hold an outlier that the gate let through because the prediction is uncertain
SUSPECT = 1e-3
#: an iteration that moves the estimate by less than this part of a frame's standard deviation is the last
SETTLED = 1e-3
#: frames; what is believed of a velocity before the first frames: what the motion makes of it in so many. With four
#: times as many, the tenth frame's camera of a panning one is off by a third of its sigma
VELOCITY_FRAMES = 100
#: standard deviations of the estimated noise's error that all scores may have in common without a change
ALLOWED = 3.0


class Recursive(Estimator):
    """A filter over a model.

    The state is an estimate with p local coordinates and, where the velocity is tracked, its velocity in
    them; L (n, n) is the factor of its covariance, n = p or 2p.

    Parameters
    ----------
    model : Model
    figures : mapping of group -> float
        The motion's figures; all zero for none.
    gain : str
        A name of `GAINS`.
    iterations : int
        Linearisations of a frame, at most; more than one needs a gain without memory.
    """

    kept: ClassVar[tuple[str, ...]] = (
        "x", "factor", "velocity", "waiting", "model", "gain", "noise", "test",
        "_process", "_walked", "_origin",
    )  # fmt: skip

    def __init__(
        self,
        options: TrackOptions,
        model: Model,
        figures: Mapping[str, float],
        gain: str,
        iterations: int = 1,
    ):
        super().__init__(options)
        self.model, self.figures, self.iterations = model, dict(figures), iterations
        self.gain = look_up(GAINS, gain, "gain")(options)
        if options.velocity and not self.gain.tracks_velocity:
            raise UsageError(
                f"the gain '{gain}' cannot follow a velocity.", "Use --gain kalman or --gain adaptive."
            )
        self.min_points = options.min_points or model.min_points
        self.noise = Noise(options.sigma)
        self.test = ChangeTest(options.false_alarm)
        self.x: Any = None
        self.factor = np.zeros((0, 0))
        self.velocity: Array | None = None
        self.waiting: list[Frame] = []
        self._process = np.zeros((0, 0))
        self._pushed = np.zeros((0, 0))  # the noise of the last prediction
        self._origin: Any = None  # the estimate when `_process` was worked out
        self._walked = np.zeros(model.size)  # motion since the covariance last followed

    def _update(self, frame: Frame, step: float) -> TrackState:
        return self._wait(frame) if self.x is None else self._advance(frame, step)

    # ------------------------------------------------------------------ the first estimate
    def _wait(self, frame: Frame) -> TrackState:
        """Collect frames until their points determine a camera; those before the first points do not count."""
        if not self.waiting and not len(frame):
            return TrackState(frame.number, "waiting", points=0)
        self.waiting.append(frame)
        joined = join(self.waiting)
        try:
            found = self._first(joined)
        except (EstimationError, DataError):  # with few points the noise may say either
            if len(self.waiting) >= PATIENCE:
                raise
            return TrackState(frame.number, "waiting", points=len(frame))
        self.waiting = []
        self.noise.add(found.equations.rest * found.sigma**2, found.equations.dof)
        self._adopt(found)
        keep = found.keep[len(found.keep) - len(frame) :]
        return self._report(frame, "started", keep, gain=1.0, a=found.equations.a)

    def _first(self, frame: Frame) -> robust.FrameFit:
        if frame.sigma is not None and self.noise.known is None and not self.options.learn_noise:
            self.noise = Noise(1.0)
        return first.fit(self.model, frame, self.noise.known, self.options.gate)

    def _adopt(self, found: robust.FrameFit) -> None:
        """Continue from a camera fitted to one frame."""
        p = self.model.size
        self.x, self.factor = found.estimate, linear.triangle(found.factor.copy())
        self.gain.begin(self.factor)
        self._origin, self._walked = None, np.zeros(p)
        self.test.reset()
        if self.options.velocity:
            self._refresh()
            rows = np.hstack([math.sqrt(VELOCITY_FRAMES) * self._process, np.zeros((p, p))])
            zero = np.zeros((p, p))
            self.factor = np.block([[self.factor, zero], [zero, linear.triangle(rows)]])
            self.velocity = np.zeros(p)

    # ------------------------------------------------------------------ frame by frame
    def _advance(self, frame: Frame, step: float) -> TrackState:
        self._predict(step)
        if len(frame) < self.min_points:
            return self._report(frame, "predicted")
        reading = self._read(frame)
        if reading is None:
            return self._report(frame, "rejected")
        verdict = self._examine(frame, reading)
        if verdict.test is not None:
            alone = reading.alone or self._alone(frame)
            if alone is None:
                return self._report(frame, "rejected")
            return self._restart(frame, reading, verdict, alone)
        equations = reading.equations
        self.noise.add(equations.rest * self.noise.sigma**2, equations.dof)
        granted = self._correct(frame, reading, verdict, step)
        return self._report(
            frame, "updated", reading.keep, reading=reading, verdict=verdict, gain=granted, a=equations.a
        )

    def _refresh(self) -> None:
        """Update the process noise and the reference of the covariance to the current camera."""
        turn = self.model.carry(self.x, self._walked)
        if turn is not None:
            p = self.model.size
            self.factor = linear.triangle(
                np.vstack([turn @ rows for rows in np.split(self.factor, len(self.factor) // p)])
            )
            self.velocity = None if self.velocity is None else turn @ self.velocity
            self._walked = np.zeros(p)
        if self._origin is None or self.model.moved(self._origin, self.x):
            self._process = self.model.motion(self.x, self.figures)
            self._origin = self.x

    def _predict(self, step: float) -> None:
        """Advance by `step` frames: random walk, or constant velocity with white acceleration."""
        self._refresh()
        q, p = self._process, self.model.size
        if self.velocity is None:
            self._pushed = np.sqrt(step) * q
            if q.shape[1]:
                self.factor = linear.triangle(np.hstack([self.factor, self._pushed]))
            return
        self.x = self.model.retract(self.x, step * self.velocity)
        self._walked = self._walked + step * self.velocity
        # the Cholesky factor of [[s³/3, s²/2], [s²/2, s]] (Bar-Shalom, Li & Kirubarajan 2001, eq. 6.2.2-12)
        place, both = np.sqrt(step**3 / 3), np.sqrt(3 * step) / 2
        moved = self.factor.copy()
        moved[:p] += step * moved[p:]
        self._pushed = np.block([[place * q, np.zeros_like(q)], [both * q, np.sqrt(step) / 2 * q]])
        self.factor = linear.triangle(np.hstack([moved, self._pushed]))

    def _read(self, frame: Frame) -> Reading | None:
        """Gate the points; return None if they fit neither the prediction nor a camera of their own."""
        design, valid = self.model.linearise(self.x, frame)
        sigma = self.noise.sigma
        whitening = 1.0 / (sigma if frame.sigma is None else sigma * frame.sigma)
        limit = self.noise.gate(self.options.gate)
        keep = near_prediction(design, valid, whitening, self.factor[: self.model.size], limit)
        alone = None
        near = np.count_nonzero(keep)
        if near < max(self.min_points, MAJORITY * len(frame)):
            alone = self._alone(frame)
            if near < self._most(frame) and alone is None:
                return None
            if alone is not None and near < SAME * np.count_nonzero(alone.keep):
                keep = alone.keep & valid
                if np.count_nonzero(keep) < self.min_points:  # the prediction sees them behind the camera
                    keep = valid
        equations = linear.compress(whitened_rows(design, keep, whitening))
        if alone is None and self.noise.tail(equations.rest, equations.dof) < SUSPECT:
            alone = self._alone(frame)
            if alone is not None and np.count_nonzero(keep & alone.keep) >= self.min_points:
                keep = keep & alone.keep
                equations = linear.compress(whitened_rows(design, keep, whitening))
        residual = design[-1][:, keep]
        innovation = float(np.sqrt((residual * residual).sum() / max(residual.shape[1], 1)))
        return Reading(equations, keep, whitening, innovation, alone)

    def _most(self, frame: Frame) -> float:
        """The number of points of a frame that must agree on a camera."""
        return max(self.min_points, len(frame) / 2)

    def _examine(self, frame: Frame, reading: Reading) -> Verdict:
        """Test the innovation; inflate the covariance first if the gain asks for it."""
        a, z = reading.equations.a, reading.equations.z
        p = len(a)
        self.factor = self.gain.inflate(self.factor, a, z)
        half = innovation_factor(a, self.factor)
        deviates = linear.solve_lower(half, z)
        nis = float(deviates @ deviates)
        dof = min(p, 2 * int(np.count_nonzero(reading.keep)))
        # no equations although the frame fits a camera: the prediction looks the other way
        score = normal_deviate(nis, dof, self.noise.dof) if dof else LARGEST
        since = self.test.since
        test = self.test.step(frame.number, score, ALLOWED * math.sqrt(dof / self.noise.dof))
        since = since if since is not None else frame.number
        return Verdict(nis, dof, score, self.test.sum, test, since, half)

    def _correct(self, frame: Frame, reading: Reading, verdict: Verdict, step: float) -> float:
        """Apply the frame's correction, relinearised until it converges; return the fraction of it that was
        applied.
        """
        p = self.model.size
        a, z, half = reading.equations.a, reading.equations.z, verdict.innovation
        gain = self.gain(self.factor, a, half, step)
        explained = z
        delta = gain @ explained
        for _ in range(1, self.iterations):
            design, valid = self.model.linearise(self.model.retract(self.x, delta[:p]), frame)
            a, z = linear.compress(whitened_rows(design, reading.keep & valid, reading.whitening))[:2]
            half = innovation_factor(a, self.factor)
            gain = self.gain(self.factor, a, half, step)
            explained = z + a @ delta[:p]
            better = gain @ explained
            moved, delta = better - delta, better
            if np.abs(a @ moved[:p]).max() < SETTLED:
                break
        if self._pushed.shape[1]:
            # the part of the correction that is the camera's own motion, not an error of the estimate before
            q = self._pushed[:p]
            self._walked = self._walked + q @ (q.T @ (a.T @ linear.solve_factored(half, explained)))
        self.factor = linear.joseph(gain, a, self.factor)
        self.x = self.model.retract(self.x, delta[:p])
        if self.velocity is not None:
            self.velocity = self.velocity + delta[p:]
        return float(np.einsum("ij,ji->", a, gain[:p])) / p

    # ------------------------------------------------------------------ after a change
    def _alone(self, frame: Frame) -> robust.FrameFit | None:
        """The camera of this frame alone, near the prediction or anywhere; None if there is none."""
        reset = self.model.motion(self.x, motion.RESET)
        prior = linear.triangle(np.hstack([self.factor[: self.model.size], reset]))
        needed = self._most(frame)
        gate = self.noise.gate(self.options.gate)
        # a sigma that rests on few degrees of freedom may be much too small, and the scatter only seem large
        scatter = first.SCATTER * self.noise.sigma * math.sqrt(gate / noise.gate(self.options.gate, math.inf))
        for start in (lambda: self.x, lambda: self.model.start(frame)):
            try:
                x = start()
                around = prior if x is self.x else self.model.prior(x)
                found = robust.fit(self.model, x, frame, self.noise.sigma, gate, around)
            except CamcalError:  # no camera from here; the caller reports a frame that fits none
                continue
            if found.keep.sum() >= needed and found.scatter <= scatter:
                return found
        return None

    def _restart(
        self, frame: Frame, reading: Reading, verdict: Verdict, alone: robust.FrameFit
    ) -> TrackState:
        p = self.model.size
        before = self.model.describe([self.x], [self.factor[:p]])
        after = self.model.describe([alone.estimate], [alone.factor])
        self.noise.add(alone.equations.rest * alone.sigma**2, alone.equations.dof)
        self._adopt(alone)
        assert verdict.test is not None
        state = self._report(
            frame, "restarted", alone.keep, reading=reading, verdict=verdict, gain=1.0, a=alone.equations.a
        )
        state.changed = True
        state.alarm = Alarm(frame.number, verdict.since, verdict.test, before, after)
        return state

    # ------------------------------------------------------------------ what is said
    def _report(
        self,
        frame: Frame,
        status: str,
        keep: Array | None = None,
        *,
        reading: Reading | None = None,
        verdict: Verdict | None = None,
        gain: float = 0.0,
        a: Array | None = None,
    ) -> TrackState:
        """The state after a frame, with the filter's current estimate."""
        p = self.model.size
        used = 0 if keep is None else int(np.count_nonzero(keep))
        state = TrackState(frame.number, status, self.x, self.factor[:p], len(frame), used)
        state.gain, state.noise, state.cusum = gain, self.noise.sigma, self.test.sum
        if a is not None:
            worth = a @ self.factor[:p]
            state.effective = p / float(np.einsum("ij,ij->", worth, worth))
        if reading is not None and verdict is not None:
            state.innovation, state.cusum = reading.innovation, verdict.cusum
            state.nis, state.nis_dof, state.score = verdict.nis, verdict.dof, verdict.score
        return state

    def finish(self) -> list[TrackState]:
        """Return no states; raise an error if the stream never showed a camera."""
        if self.x is None and self.waiting:
            self._first(join(self.waiting))  # raises what stood in the way
        return []
