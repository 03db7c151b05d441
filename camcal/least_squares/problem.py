"""Input and output of the least-squares loop: problems, options, statistics; and small ready-made problems."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np

from camcal.records import dataclass

Array = np.ndarray

#: λ at the start: nearly Gauss-Newton, as the problems start from closed forms or from rough fits
START = 1e-4

CONVERGED, ROUNDING = "predicted decrease", "rounding"
STUCK, SINGULAR = "no step decreases the cost", "singular"
#: a rejected step was the last, and the shorter one promises too little, though the minimum is not near
EDGE = "the border of the problem's domain was reached"
#: see `Options.still`
STILL = "a flat valley: the parameters still move, the residuals do not"
INVALID = "the start lies outside the domain of the problem"


@dataclass(frozen=True)
class Options:
    """The stopping criteria.

    Attributes
    ----------
    tolerance : float or (K,) array
        Converged where the predicted decrease is at most this part of the cost. 1e-14 leaves the parameters of a
        calibration within 1e-5 of their standard deviations at 1e4 points; see `negligible` for small problems.
    max_iterations : int, optional
        Accepted and rejected steps.
    max_seconds : float, optional
    damping : float
        λ at the start.
    still : float
        Ended where ten steps have lowered the cost by less than this part of it, and go on doing so: along a curved
        valley, in which parameters replace each other, or against the end of the domain. A step moves the residuals
        by at most the root of twice its predicted decrease. 0 = never.
    """

    tolerance: float | Array = 1e-14
    max_iterations: int | None = None
    max_seconds: float | None = None
    damping: float = START
    still: float = 0.0


@dataclass(frozen=True)
class Stats:
    """Statistics of the loop for each of K members.

    Attributes
    ----------
    iterations : (K,) int array
        Accepted and rejected steps.
    evaluations : (K,) int array
        Linearisations, the first included.
    invalid : (K,) int array
        Steps out of the problem's domain.
    reasons : (K,) array of str
        Why it stopped.
    """

    iterations: Array
    evaluations: Array
    invalid: Array
    reasons: Array

    @property
    def converged(self) -> Array:
        """Return which members converged, (K,) bool."""
        return (self.reasons == CONVERGED) | (self.reasons == ROUNDING) | (self.reasons == STILL)


class Normal(NamedTuple):
    """Normal equations of K small problems.

    Attributes
    ----------
    cost : (K,) array
        ½ Σ r²; inf outside the problem's domain.
    matrix : (K, n, n) array, JᵀJ
    gradient : (K, n) array, Jᵀr
    """

    cost: Array
    matrix: Array
    gradient: Array

    @classmethod
    def of(cls, residuals: Array, jacobian: Array) -> Normal:
        """Return the equations of residuals (K, N) and their derivatives (K, n, N)."""
        gradient = np.matmul(jacobian, residuals[..., None])[..., 0]
        cost = 0.5 * np.matmul(residuals[:, None], residuals[..., None])[:, 0, 0]
        return cls(cost, np.matmul(jacobian, jacobian.transpose(0, 2, 1)), gradient)


class Problem(Protocol):
    """The input of `minimise`: `count` independent problems of one type.

    States and equations of several members are arrays, or named tuples of arrays, with the members along the first
    axis. Those of a problem with one member may be anything; its equations have a `cost` (1,).
    """

    count: int
    #: a cost (K,), or for all members, that rounding alone makes
    rounding: Any

    def linearise(self, state: Any, members: Array) -> Any:
        """Return the equations, with a `cost` (M,), of M members (indices) at their states (M, ...); inf outside
        the domain.
        """
        ...

    def solve(self, state: Any, equations: Any, damping: Array) -> tuple[Any, Array]:
        """Return the steps (M, ...) for λ (M,), and the decreases (M,) that (1) predicts; NaN where it has no
        solution.
        """
        ...

    def retract(self, state: Any, step: Any) -> Any:
        """Return the states after the steps."""
        ...

    def tried(self, trial: Trial) -> None:
        """Learn from a trial; called after every trial."""
        ...


class Small:
    """A problem whose state is an array (K, n) that steps are added to and whose equations are `Normal`."""

    count: int
    rounding: Any = 0.0

    def solve(self, state: Any, equations: Normal, damping: Array) -> tuple[Array, Array]:
        """See `damped_steps`."""
        return damped_steps(equations.matrix, equations.gradient, damping)

    def retract(self, state: Any, step: Array) -> Any:
        """Return the states plus the steps."""
        return state + step

    def tried(self, trial: Trial) -> None:
        """Do nothing: this problem does not learn from trials."""


class Differences(Small):
    """One problem whose derivatives are differences of its residuals (N,), a function of its unknowns (n,)."""

    count = 1

    def __init__(self, residuals: Callable[[Array], Array], step: float):
        self.residuals, self.step = residuals, step

    def linearise(self, state: Array, members: Array) -> Normal:
        """The equations; the cost is inf where a residual is not finite."""
        x = state[0]
        with np.errstate(over="ignore", invalid="ignore"):
            now = self.residuals(x)
            columns = [(self.residuals(x + move) - now) / self.step for move in self.step * np.eye(len(x))]
            found = Normal.of(now[None], np.array(columns)[None])
        finite = np.isfinite(found.matrix).all() and np.isfinite(found.cost).all()
        return found if finite else found._replace(cost=np.array([np.inf]))


@dataclass(frozen=True)
class Trial:
    """A trial step of M members: the equations before and after it, λ's predicted decreases, the gains."""

    iteration: int
    evaluations: int
    members: Array  #: (M,) indices
    before: Any
    after: Any
    step: Any
    predicted: Array  #: (M,)
    gain: Array  #: (M,) decreases of the cost over the predicted ones
    accepted: Array  #: (M,) bool


class Found(NamedTuple):
    """States and equations of all members at the end of the loop, and its statistics."""

    state: Any
    equations: Any
    stats: Stats


def negligible(part: float, observations: Array | float, unknowns: int) -> Array:
    """Return the tolerance that stops within `part` standard deviations of the minimum.

    A step δ along a parameter predicts ½ (δ/s)² σ², with the cost ½ (N − n) σ² of N residuals and n unknowns.
    """
    return part**2 / np.maximum(observations - unknowns, 1.0)


def damped_steps(matrix: Array, gradient: Array, damping: Array) -> tuple[Array, Array]:
    """Solve (1) for many small problems, with their diagonals scaled to 1.

    Parameters
    ----------
    matrix : (K, n, n) array
    gradient : (K, n) array
    damping : (K,) array

    Returns
    -------
    steps : (K, n) array
    predicted : (K,) array
        Decreases of the cost, ½ (λ δᵀ D δ − gᵀ δ); NaN where the equations are not finite.
    """
    count, n = gradient.shape
    diagonal = matrix.reshape(count, n * n)[:, :: n + 1]
    scale = 1.0 / np.sqrt(np.where(diagonal == 0, 1.0, diagonal))  # a parameter that moves nothing stays
    scaled = matrix * scale[:, :, None]
    scaled *= scale[:, None, :]
    # the rounding of the products: a matrix that is singular but for it stays solvable
    scaled.reshape(count, n * n)[:, :: n + 1] = (1.0 + n * np.finfo(float).eps + damping)[:, None]
    right = gradient * scale
    unit = np.linalg.solve(scaled, right[..., None])[..., 0]
    predicted = 0.5 * (unit * (damping[:, None] * unit + right)).sum(1)
    unit *= -scale
    return unit, predicted
