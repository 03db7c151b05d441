"""Gauss-Newton on the Schur complement, with the step halved until the cost falls (Armijo 1966)."""

from __future__ import annotations

from camcal.solve.linear import FORMS as VARIANTS
from camcal.solve.optimizers.base import NOISE, NewtonRun, OnStep, Options, Result
from camcal.solve.problem import Problem, State, Step

__all__ = ["VARIANTS", "minimise"]

#: least decrease of a step relative to that predicted by the slope
_SUFFICIENT = 1e-4
#: halvings of a step at most, to 1e-9 of it
_HALVINGS = 30
#: a limit of work: a run that reaches it ends as not converged
_MOST_ITERATIONS = 200


def minimise(
    problem: Problem, state: State, options: Options | None = None, on_step: OnStep | None = None
) -> Result:
    """Minimise by undamped steps; fails with `singular` if the step is not determined."""
    run = NewtonRun(problem, state, options, on_step)
    while run.iteration < (run.options.max_iterations or _MOST_ITERATIONS):
        if run.recorder.late():
            return run.ended(False, "time")
        run.iteration += 1
        solved = run.linear.step(run.state, run.blocks, 0.0)
        if solved is None:
            return run.ended(False, "singular")
        step, predicted = solved
        if predicted <= run.enough:
            return run.ended(True, "predicted decrease")
        length = 1.0
        for _ in range(_HALVINGS):
            trial, blocks = run.linearise(Step(length * step.intrinsics, length * step.poses))
            if blocks is not None and blocks.cost <= run.blocks.cost - _SUFFICIENT * length * 2 * predicted:
                run.accept(trial, blocks)
                break
            length *= 0.5
        else:
            if predicted <= NOISE * run.blocks.cost:
                return run.ended(True, "rounding")
            return run.ended(False, "no step decreases the cost")
    return run.ended(False, "iterations")
