"""Levenberg-Marquardt on the Schur complement (Marquardt 1963; Moré 1978 for the scaling by the diagonal)."""

from __future__ import annotations

from camcal.errors import EstimationError
from camcal.refine.optimizers.base import OnStep, Options, Result
from camcal.refine.problem import Problem, State
from camcal.refine.schur import Reduced

#: damping at the start, relative to the diagonal: nearly Gauss-Newton, as the closed forms start close by
START = 1e-4
#: below this a damping changes no digit of a step that matters
SMALLEST = 1e-11
#: above this a step no longer moves anything
LARGEST = 1e12


def minimise(
    problem: Problem, state: State, options: Options | None = None, on_step: OnStep | None = None
) -> Result:
    """Minimise the problem's cost from a state.

    Every trial is linearised at once, as nearly all are accepted; a rejected one costs its derivatives.
    Stops where the predicted decrease is below `options.tolerance` of the cost (or below rounding), so that
    no steps are spent on differences that the arithmetic does not resolve.

    Raises
    ------
    EstimationError
        Where the start itself cannot be projected.
    """
    options = options or Options()
    blocks = problem.linearise(state)
    if blocks is None:
        raise EstimationError(
            "the start of the refinement does not project into the image: points lie behind the camera or "
            "outside the lens model's domain.",
            "Try a simpler model, or one for wide lenses: --model kb4.",
        )
    damping, growth = START, 10.0
    trace, evaluations = [blocks.cost], 1
    for iteration in range(1, options.max_iterations + 1):
        solved = Reduced(blocks, damping).step()
        if solved is None:
            damping, growth = damping * growth, growth * 2
            if damping > LARGEST:
                return Result(state, blocks, False, "singular", iteration, evaluations, tuple(trace))
            continue
        step, predicted = solved
        if predicted <= options.tolerance * blocks.cost + problem.rounding:
            return Result(state, blocks, True, "predicted decrease", iteration, evaluations, tuple(trace))
        trial = problem.retract(state, step)
        trial_blocks = problem.linearise(trial)
        evaluations += 1
        gain = (blocks.cost - trial_blocks.cost) / predicted if trial_blocks is not None else -1.0
        if trial_blocks is not None and gain > 1e-4:
            state, blocks = trial, trial_blocks
            growth = 10.0
            if gain > 0.5:
                damping = max(damping * (0.01 if gain > 0.9 else 0.1), SMALLEST)
            elif gain < 0.25:
                damping *= 10.0
            trace.append(blocks.cost)
            if on_step:
                on_step(iteration, blocks.cost)
        elif predicted <= 1e-11 * blocks.cost and damping <= 1e-3:
            # nearly an undamped step, and rounding in the cost hides what it gains
            return Result(state, blocks, True, "rounding", iteration, evaluations, tuple(trace))
        else:
            damping, growth = max(damping, 1e-8) * growth, growth * 2
            if damping > LARGEST:
                return Result(
                    state, blocks, False, "no step decreases the cost", iteration, evaluations, tuple(trace)
                )
    return Result(state, blocks, False, "iterations", options.max_iterations, evaluations, tuple(trace))
