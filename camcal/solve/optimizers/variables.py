"""The variables of a gradient method.

A gradient's direction depends on the units of the variables, which must therefore be chosen for methods that use
nothing else. Three choices:

- `varpro`: the poses are eliminated (variable projection, G. Golub and V. Pereyra 1973): the cost is that at
  the best poses for the parameters, found by inner solves, its gradient that of the reduced function, and the
  columns of what is left are scaled to unit length;
- `scaled`: all unknowns, the columns of the Jacobian scaled to unit length at the start;
- `plain`: all unknowns in the units of the problem: pixels, radians, the unit of the board.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from camcal.records import dataclass
from camcal.solve import tangent
from camcal.solve.optimizers.base import Options, begin
from camcal.solve.poses import solve_poses
from camcal.solve.problem import Blocks, Problem, State, Step
from camcal.solve.schur import Reduced

Array = np.ndarray

VARIANTS = ("varpro", "scaled", "plain")
DESCRIBED = {
    "varpro": "camera only, poses eliminated by inner solves, scaled columns",
    "scaled": "camera and poses, scaled columns",
    "plain": "camera and poses, no scaling",
}


@dataclass(frozen=True)
class Place:
    """A point of the search with its cost and its gradient (n,) with respect to the variables."""

    state: State
    blocks: Blocks
    cost: float
    gradient: Array


class Variables(ABC):
    """The cost as a function of a vector around a point; counts the passes over the data.

    Attributes
    ----------
    noise : float
        The relative difference of the cost between two evaluations at one place.
    reach : float
        Approximate distance to the minimum: that which changes the residuals by their own length.
    """

    noise = 1e-14  # the rounding of a sum of squares

    def __init__(self, problem: Problem):
        self.problem = problem
        self.evaluations = 0
        self.scale: Array = np.zeros(0)
        self.start: Place
        self.reach = 1.0

    @abstractmethod
    def move(self, place: Place, step: Array) -> Place | None:
        """The point after a step (n,); None if a point leaves the lens's domain."""

    def _evaluate(self, state: State) -> Blocks | None:
        self.evaluations += 1
        return self.problem.linearise(state)


class AllUnknowns(Variables):
    """Free parameters and poses as variables."""

    def __init__(self, problem: Problem, state: State, scaled: bool):
        super().__init__(problem)
        blocks = begin(problem, state)
        self.evaluations = 1
        squares = tangent.diagonal(blocks)
        self.scale = tangent.inverse_lengths(squares) if scaled else np.ones(len(squares))
        self.start = self._place(state, blocks)
        g = self.start.gradient
        curvature = (self.scale * g) @ tangent.multiply(blocks, self.scale * g)
        self.reach = float(np.sqrt(2 * blocks.cost * (g @ g) / curvature)) if curvature > 0 else 1.0

    def _place(self, state: State, blocks: Blocks) -> Place:
        return Place(state, blocks, blocks.cost, self.scale * tangent.gradient(blocks))

    def move(self, place: Place, step: Array) -> Place | None:
        """A retraction."""
        moved = tangent.unflat(self.scale * step, *tangent.sizes(place.blocks))
        state = self.problem.retract(place.state, moved)
        blocks = self._evaluate(state)
        return None if blocks is None else self._place(state, blocks)


class WithoutPoses(Variables):
    """The free parameters alone as variables; every evaluation solves for the poses."""

    noise = 1e-12  # error of the inner solves

    def __init__(self, problem: Problem, state: State):
        super().__init__(problem)
        begin(problem, state)
        found = self._settle(state)
        assert found is not None  # the start projects
        state, blocks = found
        self.scale = np.ones(len(blocks.gradient))
        reduced = Reduced(blocks)
        if reduced.solvable:
            self.scale = tangent.inverse_lengths(np.diag(reduced.matrix))
        self.start = self._place(state, blocks)
        self.reach = float(np.sqrt(2 * blocks.cost))  # the reduced columns are shorter than 1

    def _settle(self, state: State) -> tuple[State, Blocks] | None:
        solved = solve_poses(self.problem, state)
        self.evaluations += solved.passes
        if not np.isfinite(solved.costs).all():
            return None
        blocks = self._evaluate(solved.state)
        return None if blocks is None else (solved.state, blocks)

    def _place(self, state: State, blocks: Blocks) -> Place:
        # the reduced gradient a - W V⁻¹ b is exact to second order in the remaining b of the inner solves
        reduced = Reduced(blocks)
        gradient = reduced.gradient if reduced.solvable else blocks.gradient
        return Place(state, blocks, blocks.cost, self.scale * gradient)

    def move(self, place: Place, step: Array) -> Place | None:
        """Take a step of the camera; the poses start at their positions by the linear model: -V⁻¹ (b + Wᵀ δa)."""
        own = self.scale * step
        poses = np.zeros_like(place.blocks.pose_gradients)
        reduced = Reduced(place.blocks)
        if reduced.solvable:
            poses = reduced.poses(own).T
        moved = self.problem.retract(place.state, Step(own, poses))
        found = self._settle(moved)
        return None if found is None else self._place(*found)


def choose(problem: Problem, state: State, options: Options) -> tuple[Variables, dict[str, str]]:
    """The variables of `options.variant`, and the entries for `Result.info`."""
    variant = options.variant or VARIANTS[0]
    made: Variables
    if variant == "varpro":
        made = WithoutPoses(problem, state)
    else:
        made = AllUnknowns(problem, state, variant == "scaled")
    return made, {"variant": variant, "variables": DESCRIBED[variant]}
