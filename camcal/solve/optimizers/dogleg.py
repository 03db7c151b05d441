"""Powell's dogleg: between steepest descent and Gauss-Newton, within a trust region.

M. J. D. Powell, A hybrid method for nonlinear equations (1970); Nocedal & Wright, section 4.1. The region is
a ball in variables scaled by the lengths of the Jacobian's columns, the longest met so far (Moré 1978).
"""

from __future__ import annotations

import numpy as np

from camcal.solve import tangent
from camcal.solve.linear import FORMS as VARIANTS
from camcal.solve.linear import Linear
from camcal.solve.optimizers.base import OnStep, Options, Recorder, Result, begin, remaining
from camcal.solve.problem import Blocks, Problem, State

__all__ = ["VARIANTS", "minimise"]

Array = np.ndarray

_MOST_ITERATIONS = 500
#: predicted decreases below this part of the cost are lost in the rounding of its sum
_NOISE = 1e-12


def minimise(
    problem: Problem, state: State, options: Options | None = None, on_step: OnStep | None = None
) -> Result:
    """Minimise; stops by the decrease that the full Gauss-Newton step predicts."""
    options = options or Options()
    linear = Linear(problem, options.variant)
    blocks, evaluations = begin(problem, state), 1
    recorder = Recorder(blocks.cost, evaluations, on_step, options)
    model, radius = _Model(linear, state, blocks), np.inf
    if model.newton is not None:
        radius = 2 * model.newton_length

    def ended(converged: bool, reason: str, iterations: int) -> Result:
        passes = evaluations + linear.passes
        return Result(
            state, blocks, converged, reason, iterations, passes, tuple(recorder.samples), linear.info()
        )

    limit = options.max_iterations or _MOST_ITERATIONS
    for iteration in range(1, limit + 1):
        if recorder.late():
            return ended(False, "time", iteration - 1)
        enough = options.tolerance * blocks.cost + problem.rounding
        if model.newton is not None and model.newton_predicted <= enough:
            return ended(True, "predicted decrease", iteration)
        scaled, predicted = model.step(radius)
        if predicted <= 1e-3 * enough:
            return ended(bool(remaining(blocks) <= enough), "the trust region has shrunk to zero", iteration)
        trial = problem.retract(state, tangent.unflat(model.scale * scaled, *tangent.sizes(blocks)))
        trial_blocks = problem.linearise(trial)
        evaluations += 1
        gain = -1.0 if trial_blocks is None else (blocks.cost - trial_blocks.cost) / predicted
        length = float(np.linalg.norm(scaled))
        if gain < 0.25:
            radius = 0.25 * length
        elif gain > 0.75:
            radius = max(radius, 3 * length)
        if trial_blocks is not None and gain > 1e-4:
            state, blocks = trial, trial_blocks
            model = _Model(linear, state, blocks, model.scale)
            recorder.add(iteration, blocks.cost, evaluations + linear.passes)
        elif predicted <= _NOISE * blocks.cost and model.newton_predicted <= 100 * _NOISE * blocks.cost:
            return ended(True, "rounding", iteration)
    return ended(False, "iterations", limit)


class _Model:
    """The quadratic model at a state, in scaled variables."""

    def __init__(self, linear: Linear, state: State, blocks: Blocks, scale: Array | None = None):
        own = tangent.inverse_lengths(tangent.diagonal(blocks))
        self.blocks = blocks
        self.scale = own if scale is None else np.minimum(own, scale)
        self.gradient = self.scale * tangent.gradient(blocks)
        solved = linear.step(state, blocks, 0.0)
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
