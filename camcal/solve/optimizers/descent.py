"""The common loop of line-search methods, which differ only in the direction."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from camcal.records import dataclass
from camcal.solve.optimizers.base import OnStep, Options, Recorder, Result, remaining
from camcal.solve.optimizers.line_search import strong_wolfe
from camcal.solve.optimizers.variables import Place, choose
from camcal.solve.problem import Problem, State

Array = np.ndarray

#: gradients alone do not determine the minimum to the last digits: costs near it differ by rounding
LEAST_TOLERANCE = 1e-9
MOST_ITERATIONS = 20_000  #: limit of iterations: a run that reaches it has not converged
#: iterations between two tests of `remaining`, which costs a solution of the normal equations
_TEST_EVERY = 5


@dataclass
class Line:
    """The information from which a method chooses its direction: the last step and both its ends."""

    before: Place
    after: Place
    step: Array  #: (n,) in the variables
    direction: Array  #: that of the step, of any length


#: the direction to go next; None = begin again along the gradient
Direction = Callable[[Line], Array | None]
#: the first length to try, from the last line (None at the start), the place and the direction
FirstLength = Callable[[Line | None, Place, Array], float]


def descend(
    problem: Problem,
    state: State,
    options: Options | None,
    on_step: OnStep | None,
    direction_of: Direction,
    first_length: FirstLength,
    curvature: float,
) -> Result:
    """Minimise by line searches for the strong Wolfe conditions with `curvature` = c2.

    Converged where the decrease that the Gauss-Newton model predicts is below `options.tolerance`, or
    `LEAST_TOLERANCE`, of the cost.
    """
    options = options or Options()
    variables, info = choose(problem, state, options)
    place, line = variables.start, None
    recorder = Recorder(place.cost, variables.evaluations, on_step, options)
    tolerance = max(options.tolerance, LEAST_TOLERANCE)
    limit = options.max_iterations or MOST_ITERATIONS
    restarts = 0

    def ended(converged: bool, reason: str, iterations: int) -> Result:
        blocks, samples, said = place.blocks, tuple(recorder.samples), {**info, "restarts": restarts}
        return Result(
            place.state, blocks, converged, reason, iterations, variables.evaluations, samples, said
        )

    def arrived() -> bool:
        return bool(remaining(place.blocks) <= tolerance * place.cost + problem.rounding)

    for iteration in range(1, limit + 1):
        if recorder.late():
            return ended(arrived(), "time", iteration - 1)
        if iteration % _TEST_EVERY == 1 and arrived():
            return ended(True, "predicted decrease", iteration - 1)
        direction = None if line is None else direction_of(line)
        if direction is None or not place.gradient @ direction < 0:
            restarts += line is not None
            direction, line = -place.gradient, None
        found = strong_wolfe(variables, place, direction, first_length(line, place, direction), curvature)
        if found is None and line is not None:  # the direction may be unsuitable: restart
            restarts += 1
            direction, line = -place.gradient, None
            found = strong_wolfe(variables, place, direction, first_length(None, place, direction), curvature)
        if found is None:
            converged = arrived()
            reason = "predicted decrease" if converged else "no step along the gradient decreases the cost"
            return ended(converged, reason, iteration)
        line = Line(place, found[0], found[1] * direction, direction)
        place = found[0]
        recorder.add(iteration, place.cost, variables.evaluations)
    return ended(arrived(), "iterations", limit)


def gradient_length(place: Place) -> float:
    """The first length along a gradient: a first-order change of the cost by its own size, |g| = sqrt(2 cost)."""
    size = float(np.linalg.norm(place.gradient))
    return min(1.0, np.sqrt(2 * place.cost) / size) if size > 0 else 1.0
