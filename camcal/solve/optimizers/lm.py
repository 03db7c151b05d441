"""Levenberg-Marquardt on the Schur complement (Marquardt 1963; Moré 1978 for the scaling by the diagonal)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from camcal.solve.linear import FORMS as VARIANTS
from camcal.solve.linear import Linear
from camcal.solve.optimizers.base import OnStep, Options, Recorder, Result, Sample, begin
from camcal.solve.optimizers.curvature import Curvature
from camcal.solve.problem import Blocks, Problem, State, Step
from camcal.solve.schur import Reduced

__all__ = ["VARIANTS", "minimise"]

#: damping at the start, relative to the diagonal: nearly Gauss-Newton, as the closed forms start close by
START = 1e-4
#: below this a damping changes no digit of a step that matters
SMALLEST = 1e-14
#: above this a step no longer moves anything
LARGEST = 1e12
#: predicted decreases below this part of the cost are lost in the rounding of its sum
_NOISE = 1e-12
_MOST_ITERATIONS = 200
#: easy problems have converged by then, so they do not pay for what follows
_LEARN_FROM = 8
EDGE = "the lens's domain ends here"
#: of the distortion, where a run is begun again
_FACTORS = (-1.0, -0.5)
#: a converged run is preferred to one that was stopped even if its cost is larger by this part
_NEARLY = 1e-3


@dataclass
class _Damping:
    """Marquardt's λ: it falls quickly, but cautiously for a while after a step that failed.

    In the curved, narrow valleys of the larger models a λ that always falls quickly is too small every other
    step, and half of the work is thrown away.
    """

    value: float = START
    since_failure: int = 99
    growth: float = 10.0

    def succeeded(self, gain: float) -> None:
        """`gain` is the decrease against the predicted one."""
        self.since_failure += 1
        self.growth = 10.0 if self.since_failure > 3 else 4.0
        factor = 1.0 if gain < 0.75 else (0.01 if self.since_failure > 3 else 0.3)
        self.value = max(self.value * (3.0 if gain < 0.25 else factor), SMALLEST)

    def failed(self) -> None:
        """A rejected step: more damping, faster each time."""
        self.value = max(self.value, 1e-12) * self.growth
        self.growth = 4.0 if self.since_failure else min(self.growth * 2.0, 1e3)
        self.since_failure = 0


def minimise(
    problem: Problem, state: State, options: Options | None = None, on_step: OnStep | None = None
) -> Result:
    """Minimise the problem's cost from a state.

    Every trial is linearised at once, as nearly all are accepted; a rejected one costs its derivatives.
    Stops where the decrease that the *undamped* model predicts is below `options.tolerance` of the cost (or
    below rounding): a damped step may promise little in the middle of a valley. Where it runs against the end
    of the lens's domain, it begins again with the distortion the other way round (see `_elsewhere`).

    Raises
    ------
    EstimationError
        Where the start itself cannot be projected.
    """
    options = options or Options()
    run = _Run(problem, state, options, on_step)
    run.descend()
    if run.reason != EDGE:
        return run.result()
    found = run.result()
    for start in _elsewhere(problem, found.state):
        other = _Run(problem, start, options, None)
        other.descend()
        found = _joined(found, other.result())
        if found.converged:
            break
    return found


class _Run:
    """One descent from a start."""

    def __init__(self, problem: Problem, state: State, options: Options, on_step: OnStep | None):
        self.problem, self.state, self.options = problem, state, options
        self.linear = Linear(problem, options.variant)
        self.blocks, self.evaluations = begin(problem, state), 1
        self.recorder = Recorder(self.blocks.cost, 1, on_step, options)
        self.damping = _Damping()
        self.curvature = Curvature(len(self.blocks.gradient))
        self.undamped: Reduced | None = None  # at the state, where the curvature is learnt
        self.iteration, self.converged, self.reason = 0, False, "iterations"

    def result(self) -> Result:
        """Where the run stands."""
        return Result(
            self.state,
            self.blocks,
            self.converged,
            self.reason,
            self.iteration,
            self.evaluations + self.linear.passes,
            tuple(self.recorder.samples),
            self.linear.info(),
        )

    def end(self, converged: bool, reason: str) -> None:
        self.converged, self.reason = converged, reason

    def descend(self) -> None:
        """Iterate to the end."""
        limit = self.options.max_iterations or _MOST_ITERATIONS
        while self.iteration < limit:
            if self.recorder.late():
                return self.end(False, "time")
            self.iteration += 1
            solved, more = self.step()
            if solved is None:
                self.damping.failed()
                if self.damping.value > LARGEST:
                    return self.end(False, "singular")
                continue
            step, predicted = solved
            enough = self.options.tolerance * self.blocks.cost + self.problem.rounding
            if predicted <= enough:
                if self.remaining(predicted) <= 10 * enough:
                    return self.end(True, "predicted decrease")
                if self.damping.since_failure == 0:
                    return self.end(False, EDGE)
            trial = self.problem.retract(self.state, step)
            blocks = self.problem.linearise(trial)
            self.evaluations += 1
            gain = (self.blocks.cost - blocks.cost) / predicted if blocks is not None else -1.0
            if blocks is not None and gain > 1e-4:
                self.accept(trial, blocks, step, predicted, gain, more)
            elif self.is_rounding(predicted):
                return self.end(True, "rounding")
            else:
                self.damping.failed()
                self.curvature.trusted = False
                if self.damping.value > LARGEST:
                    return self.end(False, "no step decreases the cost")
        return None

    def step(self) -> tuple[tuple[Step, float] | None, bool]:
        """The step with its predicted decrease, and whether it rests on the learnt curvature."""
        if self.curvature.trusted:
            solved = self.linear.step(self.state, self.blocks, self.damping.value, self.curvature.matrix)
            if solved is not None:
                return solved, True
        return self.linear.step(self.state, self.blocks, self.damping.value), False

    def remaining(self, damped: float) -> float:
        """The decrease that the model predicts without damping; the damped one where that is unsolvable."""
        found = self.linear.step(self.state, self.blocks, 0.0)
        return damped if found is None else found[1]

    def is_rounding(self, predicted: float) -> bool:
        """Whether a rejected step says no more than that costs are sums of rounded numbers."""
        noise = _NOISE * self.blocks.cost
        return predicted <= noise and self.remaining(predicted) <= 100 * noise

    def accept(
        self, state: State, blocks: Blocks, step: Step, predicted: float, gain: float, more: bool
    ) -> None:
        """Take a step that lowered the cost."""
        if self.iteration >= _LEARN_FROM:
            self.learn(blocks, step, predicted, gain * predicted, more)
        self.state, self.blocks = state, blocks
        self.damping.succeeded(gain)
        self.recorder.add(self.iteration, blocks.cost, self.evaluations + self.linear.passes)

    def learn(self, blocks: Blocks, step: Step, predicted: float, actual: float, more: bool) -> None:
        """Update the curvature, and use it where it would have foretold this decrease better."""
        before = self.undamped or Reduced(self.blocks, 0.0, self.problem.normalise)
        after = Reduced(blocks, 0.0, self.problem.normalise)
        self.undamped = None
        if not (before.solvable and after.solvable):
            self.curvature.trusted = False
            return
        extra = self.curvature.along(step.intrinsics)
        without, with_ = (predicted + extra, predicted) if more else (predicted, predicted - extra)
        self.curvature.learn(step.intrinsics, before, after)
        self.curvature.trusted = abs(actual - with_) <= abs(actual - without)
        self.undamped = after


def _elsewhere(problem: Problem, state: State) -> Iterator[State]:
    """Starts on the other side, for a run that a fold or a pole of the lens has stopped.

    Distortion that pushes its pole against the outermost points is an over-parameterised model's; with its
    sign turned, poles are gone or lie elsewhere, and so does the minimum that is reached from there.
    """
    own = [
        i for i, p in enumerate(problem.lens.parameters) if p.group == "distortion" and problem.free[i].any()
    ]
    for factor in _FACTORS:
        params = state.params.copy()
        params[own] *= factor
        start = replace(state, params=params)
        if problem.linearise(start) is not None:
            yield start


def _joined(first: Result, second: Result) -> Result:
    """The better of two runs, with the work of both in its figures."""
    better = second if second.blocks.cost < first.blocks.cost else first
    if second.converged and second.blocks.cost <= (1 + _NEARLY) * first.blocks.cost:
        better = second
    samples, done = list(first.samples), first.samples[-1]
    if better is second:
        samples += [
            Sample(
                first.iterations + s.iteration,
                s.cost,
                first.evaluations + s.evaluations,
                done.seconds + s.seconds,
            )
            for s in second.samples
            if s.cost < done.cost
        ]
    return replace(
        better,
        iterations=first.iterations + second.iterations,
        evaluations=first.evaluations + second.evaluations,
        samples=tuple(samples),
        info={**better.info, "restarts": first.info.get("restarts", 0) + 1},
    )
