"""Levenberg-Marquardt on the Schur complement (Marquardt 1963; Moré 1978 for the scaling by the diagonal)."""

from __future__ import annotations

from dataclasses import dataclass

from camcal.refine.linear import FORMS as VARIANTS
from camcal.refine.linear import Linear
from camcal.refine.optimizers.base import OnStep, Options, Recorder, Result, begin
from camcal.refine.problem import Problem, State

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
    below rounding): a damped step may promise little in the middle of a valley.

    Raises
    ------
    EstimationError
        Where the start itself cannot be projected.
    """
    options = options or Options()
    linear = Linear(problem, options.variant)
    blocks, evaluations = begin(problem, state), 1
    damping, recorder = _Damping(), Recorder(blocks.cost, evaluations, on_step)

    def ended(converged: bool, reason: str, iterations: int) -> Result:
        passes, samples = evaluations + linear.passes, tuple(recorder.samples)
        return Result(state, blocks, converged, reason, iterations, passes, samples, linear.info())

    def undamped(damped: float) -> float:
        """The decrease that the model predicts without damping; the damped one where that is unsolvable."""
        found = linear.step(state, blocks, 0.0)
        return damped if found is None else found[1]

    limit = options.max_iterations or _MOST_ITERATIONS
    for iteration in range(1, limit + 1):
        solved = linear.step(state, blocks, damping.value)
        if solved is None:
            damping.failed()
            if damping.value > LARGEST:
                return ended(False, "singular", iteration)
            continue
        step, predicted = solved
        enough = options.tolerance * blocks.cost + problem.rounding
        if predicted <= enough:
            if undamped(predicted) <= 10 * enough:
                return ended(True, "predicted decrease", iteration)
            if damping.since_failure == 0:
                return ended(False, "the lens's domain ends here", iteration)
        trial = problem.retract(state, step)
        trial_blocks = problem.linearise(trial)
        evaluations += 1
        gain = (blocks.cost - trial_blocks.cost) / predicted if trial_blocks is not None else -1.0
        if trial_blocks is not None and gain > 1e-4:
            state, blocks = trial, trial_blocks
            damping.succeeded(gain)
            recorder.add(iteration, blocks.cost, evaluations + linear.passes)
        elif predicted <= _NOISE * blocks.cost and undamped(predicted) <= 100 * _NOISE * blocks.cost:
            return ended(True, "rounding", iteration)
        else:
            damping.failed()
            if damping.value > LARGEST:
                return ended(False, "no step decreases the cost", iteration)
    return ended(False, "iterations", limit)
