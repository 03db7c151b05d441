"""Powell's dogleg: between steepest descent and Gauss-Newton, within a trust region.

M. J. D. Powell, A hybrid method for nonlinear equations (1970); Nocedal & Wright, section 4.1. The region is
a ball in variables scaled by the lengths of the Jacobian's columns, the largest so far (Moré 1978).
"""

from __future__ import annotations

import numpy as np

from camcal.solve import tangent
from camcal.solve.linear import FORMS as VARIANTS
from camcal.solve.optimizers.base import NOISE, NewtonRun, OnStep, Options, Result, remaining
from camcal.solve.problem import Problem, State

__all__ = ["VARIANTS", "minimise"]

Array = np.ndarray

#: a limit of work: a run that reaches it ends as not converged
_MOST_ITERATIONS = 500
#: ratio of the decrease to the predicted one below which the region shrinks, and above which it grows (Nocedal &
#: Wright, algorithm 4.1)
_POOR, _GOOD = 0.25, 0.75
#: the new radius, in lengths of the step (Nocedal & Wright; K. Madsen, H. Nielsen & O. Tingleff, Methods for
#: Non-Linear Least Squares Problems, 2004, algorithm 3.21)
_SMALLER, _LARGER = 0.25, 3
#: ratio above which a step is accepted: some decrease, as in the first Wolfe condition
_ACCEPTED = 1e-4
#: of the decrease that ends a run: a region in which less can be gained has collapsed
_SHRUNK = 1e-3
#: of the decrease of the full Gauss-Newton step: if that is also rounding, a rejected step ends the run
_OF_NEWTON = 0.01


def minimise(
    problem: Problem, state: State, options: Options | None = None, on_step: OnStep | None = None
) -> Result:
    """Minimise; stops by the decrease that the full Gauss-Newton step predicts."""
    run = NewtonRun(problem, state, options, on_step)
    model, radius = _Model(run), np.inf
    if model.newton is not None:
        radius = 2 * model.newton_length
    while run.iteration < (run.options.max_iterations or _MOST_ITERATIONS):
        if run.recorder.late():
            return run.ended(False, "time")
        run.iteration += 1
        if model.newton is not None and model.newton_predicted <= run.enough:
            return run.ended(True, "predicted decrease")
        scaled, predicted = model.step(radius)
        if predicted <= _SHRUNK * run.enough:
            converged = remaining(run.blocks) <= run.enough
            return run.ended(bool(converged), "the trust region has shrunk to zero")
        trial, blocks = run.linearise(tangent.unflat(model.scale * scaled, *tangent.sizes(run.blocks)))
        gain = -1.0 if blocks is None else (run.blocks.cost - blocks.cost) / predicted
        length = float(np.linalg.norm(scaled))
        if gain < _POOR:
            radius = _SMALLER * length
        elif gain > _GOOD:
            radius = max(radius, _LARGER * length)
        if blocks is not None and gain > _ACCEPTED:
            run.accept(trial, blocks)
            model = _Model(run, model.scale)
        elif max(predicted, _OF_NEWTON * model.newton_predicted) <= NOISE * run.blocks.cost:
            return run.ended(True, "rounding")
    return run.ended(False, "iterations")


class _Model:
    """The quadratic model at a state, in scaled variables."""

    def __init__(self, run: NewtonRun, scale: Array | None = None):
        self.blocks = blocks = run.blocks
        own = tangent.inverse_lengths(tangent.diagonal(blocks))
        self.scale = own if scale is None else np.minimum(own, scale)
        self.gradient = self.scale * tangent.gradient(blocks)
        solved = run.linear.step(run.state, blocks, 0.0)
        self.newton: Array | None = None
        self.newton_predicted = self.newton_length = np.inf
        if solved is not None:
            self.newton, self.newton_predicted = tangent.flat(solved[0]) / self.scale, solved[1]
            self.newton_length = float(np.linalg.norm(self.newton))

    def curvature(self, a: Array, b: Array) -> float:
        """aᵀ JᵀJ b."""
        return float((self.scale * a) @ tangent.multiply(self.blocks, self.scale * b))

    def step(self, radius: float) -> tuple[Array, float]:
        """The step within a radius, and the decrease that the model predicts for it."""
        if self.newton is not None and self.newton_length <= radius:
            return self.newton, self.newton_predicted
        square = float(self.gradient @ self.gradient)
        cauchy = -self.gradient * (square / self.curvature(self.gradient, self.gradient))
        length = float(np.linalg.norm(cauchy))
        if length >= radius:
            step = cauchy * (radius / length)
        elif self.newton is None:
            step = cauchy
        else:  # where the leg from the Cauchy point to the Newton point leaves the ball
            leg = self.newton - cauchy
            a, b, c = leg @ leg, 2 * cauchy @ leg, length**2 - radius**2
            step = cauchy + leg * (2 * -c / (b + np.sqrt(b * b - 4 * a * c)))
        return step, -float(self.gradient @ step) - 0.5 * self.curvature(step, step)
