"""scipy.optimize.least_squares, a reference that shares only the residuals with the other methods.

Its variables are the free parameters and, for each pose, a rotation vector on top of the start's rotation and
a translation. Steps come from an SVD of the dense Jacobian, or by LSMR from a sparse one where that is too
large.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.optimize import least_squares

from camcal.geometry import rotations
from camcal.solve import rows, tangent
from camcal.solve.optimizers.base import OnStep, Options, Recorder, Result, begin, remaining
from camcal.solve.problem import Problem, State

Array = np.ndarray

VARIANTS = ("trf", "dogbox")
#: entries of the Jacobian up to which it is dense: 160 MB
_DENSE = 20_000_000
#: least tolerance of the cost passed to scipy; and that for x, so that only the cost ends a run: two roundings
_COARSEST, _ROUNDING = 1e-3, 4e-16
#: remaining decrease of a converged run, in tolerances, and relative to the cost: scipy stops by the decrease of its
#: last step, after which more may remain than with the predicted decrease that the other methods use
_LEFT, _LEAST_LEFT = 1e3, 1e-11
_MOST_EVALUATIONS = 1000  #: a limit of work, five times that of the least-squares loop


class _LateError(Exception):
    """Raised when `Options.max_seconds` have passed."""


class _Function:
    """Residuals and Jacobian as functions of a vector; remembers the last state and counts evaluations."""

    def __init__(self, problem: Problem, state: State, recorder: Recorder):
        self.problem, self.start, self.recorder = problem, state, recorder
        self.evaluations, self.iteration = 1, 0
        self.best = np.zeros(problem.variables + 6 * problem.instants)
        self.free = problem.variables
        self.sparse = rows.count(problem) * (self.free + 6 * problem.instants) > _DENSE

    def state(self, x: Array) -> State:
        """The state at a vector."""
        return self.problem.retract(self.start, tangent.unflat(x, self.free))

    def residuals(self, x: Array) -> Array:
        """Residuals; NaN outside the lens's domain, where the trust region shrinks."""
        if self.recorder.late():
            raise _LateError
        self.evaluations += 1
        found = rows.residuals(self.problem, self.state(x))
        return np.full(rows.count(self.problem), np.nan) if found is None else found

    def jacobian(self, x: Array) -> Any:
        """The Jacobian by the vector: rotations compose, exp(x + dx) = exp(J(x) dx) exp(x)."""
        self.evaluations += 1
        poses = x[self.free :].reshape(-1, 6)
        turn = np.zeros((len(poses), 6, 6))
        turn[:, :3, :3] = rotations.left_jacobian(poses[:, :3])
        turn[:, 3:, 3:] = np.eye(3)
        found = rows.jacobian(self.problem, self.state(x), turn, self.sparse)
        assert found is not None  # called only if the residuals are finite
        self.iteration += 1
        return found

    def note(self, x: Array, cost: float) -> None:
        """Record an accepted step."""
        if cost < self.recorder.samples[-1].cost:
            self.best = x.copy()
            self.recorder.add(self.iteration, cost, self.evaluations)


def minimise(
    problem: Problem, state: State, options: Options | None = None, on_step: OnStep | None = None
) -> Result:
    """Minimise with columns scaled by the Jacobian; convergence is judged as for the other methods, by
    `remaining`.
    """
    options = options or Options()
    first = begin(problem, state)
    recorder = Recorder(first.cost, 1, on_step, options)
    function = _Function(problem, state, recorder)
    accuracy = float(np.clip(options.tolerance, _ROUNDING, _COARSEST))

    def jacobian(x: Array) -> Any:
        j = function.jacobian(x)
        blocks = rows.residuals(problem, function.state(x))
        if blocks is not None:
            function.note(x, 0.5 * float(blocks @ blocks))
        return j

    try:
        found = least_squares(
            function.residuals,
            function.best,
            jacobian,
            method=options.variant or VARIANTS[0],  # type: ignore[arg-type]
            x_scale="jac",
            ftol=accuracy,
            xtol=_ROUNDING,
            gtol=None,
            tr_solver="lsmr" if function.sparse else "exact",
            max_nfev=options.max_iterations or _MOST_EVALUATIONS,
        )
        x, message, reason = found.x, found.message, None if found.status else "evaluations"
    except _LateError:
        x, message, reason = function.best, "", "time"
    state = function.state(x)
    blocks = begin(problem, state)
    function.note(x, blocks.cost)
    limit = max(_LEFT * options.tolerance, _LEAST_LEFT) * blocks.cost + problem.rounding
    converged = bool(remaining(blocks) <= limit)
    if reason is None:
        reason = "predicted decrease" if converged else "the cost or the variables hardly change"
    return Result(
        state,
        blocks,
        converged,
        reason,
        function.iteration,
        function.evaluations,
        tuple(recorder.samples),
        {"variables": "camera and poses, scaled columns", "message": message},
    )
