"""The leap-frog method: the path of a particle in the force field -∇f, decelerated when it climbs.

J. A. Snyman, A new and dynamic method for unconstrained minimization, Appl. Math. Modelling 6 (1982) 449, and
An improved version of the original leap-frog dynamic method: LFOP1(b), Appl. Math. Modelling 7 (1983) 216;
the steps as in Snyman, Practical Mathematical Optimization (2005). With a = -∇f:

    x' = x + v Δt,  v' = v + a(x') Δt                                                                    (1)

- While |v| increases, potential energy decreases. When |v| decreases, the particle goes back half a step and keeps a
  quarter of v + v'; when that happens more than j times in a row, it starts from rest.
- Time step: a step longer than δ is cut to δ; otherwise Δt grows by a factor p, which itself grows by δ1 a
  step; when the acceleration turns against its predecessor m times in a row, Δt is halved and the last step
  too. The first Δt makes the first step δ / 10 long.

The published values δ1 = 0.001, m = 3, j = 2 are kept; δ is left to the user in the papers.
"""

from __future__ import annotations

import numpy as np

from camcal.records import dataclass
from camcal.solve.optimizers.base import OnStep, Options, Recorder, Result, remaining
from camcal.solve.optimizers.descent import LEAST_TOLERANCE
from camcal.solve.optimizers.variables import VARIANTS, Place, Variables, choose
from camcal.solve.problem import Problem, State

__all__ = ["VARIANTS", "minimise"]

Array = np.ndarray

GROWTH = 0.001  #: δ1
TURNS = 3  #: m
RESTS = 2  #: j
MOST_STEPS = 50_000  #: a limit of work: a run that reaches it ends as not converged
_TEST_EVERY = 10  #: steps between two tests of `remaining`, which costs a solution of the normal equations


@dataclass
class _Particle:
    """Position, velocity and the memory of the step control."""

    place: Place
    longest: float  #: δ
    velocity: Array
    interval: float  #: Δt
    factor: float = 1.0  #: p
    turned: int = 0  #: accelerations in a row against their predecessors
    slowed: int = 0  #: steps in a row that lost speed
    rests: int = RESTS
    last: Array | None = None  #: the last step, for going back half of it

    @classmethod
    def at_rest(cls, place: Place, longest: float) -> _Particle:
        force = -place.gradient
        interval = np.sqrt(longest / (5 * np.linalg.norm(force)))
        return cls(place, longest, 0.5 * force * interval, interval)

    def control(self, variables: Variables) -> None:
        """Set the time step before a leap."""
        length = float(np.linalg.norm(self.velocity)) * self.interval
        if length < self.longest:
            self.factor += GROWTH
            self.interval *= self.factor
        else:
            self.velocity *= self.longest / length
        if self.turned >= TURNS:
            self.interval *= 0.5
            self.velocity *= 0.25
            if self.last is not None:
                self.back_half(variables)
            self.turned = 0

    def back_half(self, variables: Variables) -> None:
        """Go back by half of the last step."""
        assert self.last is not None
        back = variables.move(self.place, -0.5 * self.last)
        if back is not None:
            self.place, self.last = back, 0.5 * self.last

    def leap(self, variables: Variables) -> None:
        """Take one step of (1)."""
        step = self.velocity * self.interval
        reached = variables.move(self.place, step)
        if reached is None:  # the lens's domain ends: rest, and go on in smaller steps
            self.interval *= 0.5
            self.longest *= 0.5
            self.velocity, self.factor = -0.5 * self.interval * self.place.gradient, 1.0
            return
        before, self.place, self.last = self.place, reached, step
        self.settle(variables, before)

    def settle(self, variables: Variables, before: Place) -> None:
        """Gain speed at a new position; if speed decreases instead, move the particle back."""
        while True:
            velocity = self.velocity - self.interval * self.place.gradient
            if self.place.gradient @ before.gradient > 0:
                self.turned = 0
            else:
                self.turned, self.factor = self.turned + 1, 1.0
            if np.linalg.norm(velocity) > np.linalg.norm(self.velocity):
                self.velocity, self.slowed = velocity, 0
                return
            before = self.place
            self.back_half(variables)
            self.slowed += 1
            if self.slowed <= self.rests:
                self.velocity = 0.25 * (self.velocity + velocity)
            else:  # from rest any force increases the speed, so the loop ends here at the latest
                self.velocity, self.rests = np.zeros_like(velocity), 1
            if not self.place.gradient.any():
                return


def minimise(
    problem: Problem, state: State, options: Options | None = None, on_step: OnStep | None = None
) -> Result:
    """Minimise by LFOP1(b); the result and the trace are those of the lowest point on the path.

    δ is the step that changes the residuals by their own length (`Variables.reach`).
    """
    options = options or Options()
    variables, info = choose(problem, state, options)
    best = variables.start
    recorder = Recorder(best.cost, variables.evaluations, on_step, options)
    tolerance = max(options.tolerance, LEAST_TOLERANCE)
    limit = options.max_iterations or MOST_STEPS

    def ended(converged: bool, reason: str, iterations: int) -> Result:
        samples = tuple(recorder.samples)
        return Result(
            best.state, best.blocks, converged, reason, iterations, variables.evaluations, samples, info
        )

    def arrived() -> bool:
        return bool(remaining(best.blocks) <= tolerance * best.cost + problem.rounding)

    if arrived():
        return ended(True, "predicted decrease", 0)
    particle = _Particle.at_rest(best, variables.reach)
    for iteration in range(1, limit + 1):
        if recorder.late():
            return ended(arrived(), "time", iteration - 1)
        particle.control(variables)
        particle.leap(variables)
        if particle.place.cost < best.cost:
            best = particle.place
            recorder.add(iteration, best.cost, variables.evaluations)
            if iteration % _TEST_EVERY == 0 and arrived():
                return ended(True, "predicted decrease", iteration)
        if not particle.longest > 0 or not np.isfinite(particle.interval):
            return ended(arrived(), "the path reached the border of the lens's domain", iteration)
    return ended(arrived(), "iterations", limit)
