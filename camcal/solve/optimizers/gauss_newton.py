"""Gauss-Newton on the Schur complement, with the step halved until the cost falls (Armijo 1966)."""

from __future__ import annotations

from camcal.solve.linear import FORMS as VARIANTS
from camcal.solve.linear import Linear
from camcal.solve.optimizers.base import OnStep, Options, Recorder, Result, begin
from camcal.solve.problem import Problem, State, Step

__all__ = ["VARIANTS", "minimise"]

#: part of the decrease that the slope promises, which a step has to bring
_SUFFICIENT = 1e-4
_HALVINGS = 30
_MOST_ITERATIONS = 200
#: predicted decreases below this part of the cost are lost in the rounding of its sum
_NOISE = 1e-12


def minimise(
    problem: Problem, state: State, options: Options | None = None, on_step: OnStep | None = None
) -> Result:
    """Minimise by undamped steps; fails with `singular` if the step is not determined."""
    options = options or Options()
    linear = Linear(problem, options.variant)
    blocks, evaluations = begin(problem, state), 1
    recorder = Recorder(blocks.cost, evaluations, on_step, options)

    def ended(converged: bool, reason: str, iterations: int) -> Result:
        passes = evaluations + linear.passes
        return Result(
            state, blocks, converged, reason, iterations, passes, tuple(recorder.samples), linear.info()
        )

    limit = options.max_iterations or _MOST_ITERATIONS
    for iteration in range(1, limit + 1):
        if recorder.late():
            return ended(False, "time", iteration - 1)
        solved = linear.step(state, blocks, 0.0)
        if solved is None:
            return ended(False, "singular", iteration)
        step, predicted = solved
        if predicted <= options.tolerance * blocks.cost + problem.rounding:
            return ended(True, "predicted decrease", iteration)
        length = 1.0
        for _ in range(_HALVINGS):
            trial = problem.retract(state, Step(length * step.intrinsics, length * step.poses))
            trial_blocks = problem.linearise(trial)
            evaluations += 1
            enough = blocks.cost - _SUFFICIENT * length * 2 * predicted
            if trial_blocks is not None and trial_blocks.cost <= enough:
                break
            length *= 0.5
        else:
            if predicted <= _NOISE * blocks.cost:
                return ended(True, "rounding", iteration)
            return ended(False, "no step decreases the cost", iteration)
        state, blocks = trial, trial_blocks
        recorder.add(iteration, blocks.cost, evaluations + linear.passes)
    return ended(False, "iterations", limit)
