"""The common input and output of all optimisers.

The one problem interface is `camcal.solve.problem.Problem`: `linearise` (cost, Jacobian blocks, gradient at
a state), `retract` (a step in the free parameters and in the poses), `rounding` (a cost that rounding alone
makes), `view_normals` and `free_rows` for those who want views or rows. Fixed and coupled parameters are
not variables: steps are taken in the free ones.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import field
from typing import Any, NamedTuple

from camcal import least_squares
from camcal.errors import EstimationError
from camcal.records import dataclass
from camcal.solve.linear import Linear
from camcal.solve.problem import Blocks, Problem, State, Step
from camcal.solve.schur import Reduced

#: predicted decreases below this fraction of the cost are lost in rounding
NOISE = 1e-12
#: called with (iteration, cost) after every accepted step
OnStep = Callable[[int, float], None]


@dataclass(frozen=True)
class Options(least_squares.Options):
    """The stopping criteria, and the variant of the method.

    Attributes
    ----------
    variant : str
        One of the method's `VARIANTS`, as after the colon of `lbfgs:varpro`; empty = its first.
    """

    tolerance: float = 1e-14
    variant: str = ""


class Sample(NamedTuple):
    """A line of the trace: cost, passes over the data and seconds so far."""

    iteration: int
    cost: float
    evaluations: int
    seconds: float


@dataclass(frozen=True)
class Result:
    """The result of an optimiser.

    Attributes
    ----------
    state : State
    blocks : Blocks
        At `state`.
    converged : bool
    stop_reason : str
    iterations : int
    evaluations : int
        Passes over all points with derivatives, including those of inner iterations.
    samples : tuple of Sample
        The start, then every accepted step; costs never increase.
    info : dict
        Further results of the method; `variables` names those of its search.
    """

    state: State
    blocks: Blocks
    converged: bool
    stop_reason: str
    iterations: int
    evaluations: int
    samples: tuple[Sample, ...]
    info: dict[str, Any] = field(default_factory=dict)

    @property
    def trace(self) -> tuple[float, ...]:
        """The costs of `samples`."""
        return tuple(s.cost for s in self.samples)


class Recorder:
    """Records the samples of a run, reports each to the caller, and checks the time limit."""

    def __init__(
        self, cost: float, evaluations: int, on_step: OnStep | None = None, options: Options | None = None
    ):
        self.begin, self.on_step = time.perf_counter(), on_step
        self.limit = None if options is None else options.max_seconds
        self.samples = [Sample(0, cost, evaluations, 0.0)]

    def late(self) -> bool:
        """Return whether `Options.max_seconds` have passed."""
        return self.limit is not None and time.perf_counter() - self.begin > self.limit

    def add(self, iteration: int, cost: float, evaluations: int) -> None:
        """Record an accepted step."""
        self.samples.append(Sample(iteration, cost, evaluations, time.perf_counter() - self.begin))
        if self.on_step:
            self.on_step(iteration, cost)


class NewtonRun:
    """A run of a method that solves the linearised problem: the present state, its steps and what was recorded.

    Attributes
    ----------
    state, blocks : the state reached, and the normal equations there
    iteration : int
        The current iteration, counted from 1.
    """

    def __init__(self, problem: Problem, state: State, options: Options | None, on_step: OnStep | None):
        self.problem, self.options = problem, options or Options()
        self.linear = Linear(problem, self.options.variant)
        self.state, self.blocks = state, begin(problem, state)
        self.evaluations, self.iteration = 1, 0
        self.recorder = Recorder(self.blocks.cost, 1, on_step, self.options)

    @property
    def enough(self) -> float:
        """A predicted decrease at which the run has converged."""
        return self.options.tolerance * self.blocks.cost + self.problem.rounding

    def linearise(self, step: Step) -> tuple[State, Blocks | None]:
        """The state after a step, and the normal equations there; None outside the lens's domain."""
        trial = self.problem.retract(self.state, step)
        self.evaluations += 1
        return trial, self.problem.linearise(trial)

    def accept(self, state: State, blocks: Blocks) -> None:
        """Move to a state and record it."""
        self.state, self.blocks = state, blocks
        self.recorder.add(self.iteration, blocks.cost, self.evaluations + self.linear.passes)

    def ended(self, converged: bool, reason: str) -> Result:
        """The result of the run."""
        passes, samples = self.evaluations + self.linear.passes, tuple(self.recorder.samples)
        info = self.linear.info()
        return Result(self.state, self.blocks, converged, reason, self.iteration, passes, samples, info)


def begin(problem: Problem, state: State) -> Blocks:
    """Return the normal equations at the start.

    Raises
    ------
    EstimationError
        If the start itself cannot be projected.
    """
    blocks = problem.linearise(state)
    if blocks is None:
        raise EstimationError(
            "the initial camera of the refinement does not project all points: some lie behind the camera or "
            "outside the lens model's domain.",
            "Try a simpler model, or one for wide lenses: --model kb4.",
        )
    return blocks


def remaining(blocks: Blocks) -> float:
    """The decrease of the cost to the minimum that the Gauss-Newton model predicts, ½ gᵀ (JᵀJ)⁻¹ g.

    The common convergence criterion of all methods. It has the unit of the cost and, unlike a gradient's norm,
    depends neither on scale nor on coordinates. If JᵀJ is singular, the least damping that makes it solvable is
    added.
    """
    for damping in (0.0, 1e-14, 1e-12, 1e-10, 1e-8):
        solved = Reduced(blocks, damping).step()
        if solved is not None:
            return float(solved[1])
    return float("inf")
