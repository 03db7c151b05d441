"""Limited-memory BFGS (J. Nocedal, Math. Computation 35, 1980; D. Liu and J. Nocedal 1989)."""

from __future__ import annotations

from collections import deque

import numpy as np

from camcal.solve.optimizers.base import OnStep, Options, Result
from camcal.solve.optimizers.descent import Line, descend, gradient_length
from camcal.solve.optimizers.variables import VARIANTS, Place
from camcal.solve.problem import Problem, State

__all__ = ["VARIANTS", "minimise"]

Array = np.ndarray

MEMORY = 20  #: pairs of steps and changes of the gradient
CURVATURE = 0.9  #: c2 of the line search
#: cosine between a step and the change of the gradient that is rounding only: some fifty units in the last place
ROUNDING = 1e-14


def minimise(
    problem: Problem, state: State, options: Options | None = None, on_step: OnStep | None = None
) -> Result:
    """Minimise with the last `MEMORY` pairs."""
    pairs: deque[tuple[Array, Array, float]] = deque(maxlen=MEMORY)

    def direction_of(line: Line) -> Array:
        change = line.after.gradient - line.before.gradient
        along = float(line.step @ change)
        # the second Wolfe condition makes this positive but for rounding
        if along > ROUNDING * np.linalg.norm(line.step) * np.linalg.norm(change):
            pairs.append((line.step, change, along))
        return -_product(pairs, line.after.gradient)

    def first_length(line: Line | None, place: Place, direction: Array) -> float:
        if line is None:
            pairs.clear()
            return gradient_length(place)
        return 1.0

    return descend(problem, state, options, on_step, direction_of, first_length, CURVATURE)


def _product(pairs: deque[tuple[Array, Array, float]], gradient: Array) -> Array:
    """The estimate of the inverse Hessian times the gradient, by the two-loop recursion (Nocedal & Wright, alg.
    7.4).
    """
    q, factors = gradient.copy(), []
    for step, change, along in reversed(pairs):
        factor = step @ q / along
        q -= factor * change
        factors.append(factor)
    if pairs:
        _, change, along = pairs[-1]
        q *= along / (change @ change)
    for (step, change, along), factor in zip(pairs, reversed(factors), strict=True):
        q += step * (factor - change @ q / along)
    return q
