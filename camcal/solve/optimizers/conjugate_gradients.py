"""Nonlinear conjugate gradients: d = -g + β d; the methods differ in the choice of β.

Restarts along the gradient after n steps and where two successive gradients are far from orthogonal (M. J. D.
Powell, Math. Programming 12, 1977): |gᵀ g'| ≥ 0.2 |g'|².
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from camcal.solve.optimizers.base import OnStep, Options, Result
from camcal.solve.optimizers.descent import Line, descend, gradient_length
from camcal.solve.optimizers.variables import Place
from camcal.solve.problem import Problem, State

Array = np.ndarray

CURVATURE = 0.1  #: c2 of the line search; descent is certain below 1/2 (Al-Baali 1985)
_ORTHOGONAL = 0.2  #: of Powell's restart test (Powell 1977)
_LEAST_STEPS = (
    10  #: between restarts where there are fewer unknowns: each restart is a step of steepest descent
)
_LONGEST = 1e8  #: the first length of a search is within this factor of 1, also where a slope is 0

#: β from the gradients before and after a step
Beta = Callable[[Array, Array], float]


def conjugate_gradients(
    problem: Problem, state: State, options: Options | None, on_step: OnStep | None, beta: Beta
) -> Result:
    """Minimise by conjugate gradients."""
    since = 0

    def direction_of(line: Line) -> Array | None:
        nonlocal since
        old, new = line.before.gradient, line.after.gradient
        since += 1
        if since >= max(len(new), _LEAST_STEPS) or abs(old @ new) >= _ORTHOGONAL * (new @ new):
            since = 0
            return None
        return -new + beta(old, new) * line.direction

    return descend(problem, state, options, on_step, direction_of, _first_length, CURVATURE)


def _first_length(line: Line | None, place: Place, direction: Array) -> float:
    """The length with the same first-order change as the last step (Nocedal & Wright, section 3.5)."""
    if line is None:
        return gradient_length(place)
    last, now = line.before.gradient @ line.step, place.gradient @ direction
    return float(np.clip(last / now, 1 / _LONGEST, _LONGEST))
