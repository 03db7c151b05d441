"""The least-squares loop: Levenberg-Marquardt for a batch of independent problems.

    minimise ½ |r_k(x)|² for each member k,    (JᵀJ + λ D) δ = −Jᵀr,    D = diag(JᵀJ)                      (1)

Corners and discs of a picture, poses of views, lens models and whole calibrations are problems handed to `minimise`.
Small ones come many at a time, and each member has its own damping and leaves the batch when it has converged; a
calibration is a batch of one, which solves (1) in its own way. D makes the steps independent of the parameters' units
(Marquardt 1963; Moré, The Levenberg-Marquardt algorithm: implementation and theory, 1978).

A member has converged where the decrease of the cost that the linear model still predicts, ½ gᵀ (JᵀJ)⁻¹ g, is a
negligible part of the cost: a test without units, in the residuals as well as in the parameters.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

Array = np.ndarray

#: Accepted are steps that bring more than this part of what the model predicts (Moré 1978, section 5).
LEAST_GAIN = 1e-4
#: λ at the start: nearly Gauss-Newton, as the problems start from closed forms or from rough fits.
START = 1e-4
#: λ below which no digit of a step changes, and above which a step moves nothing.
SMALLEST, LARGEST = 1e-14, 1e12
#: Predicted decreases below these parts of the cost are lost in the rounding of its sum: of a damped step that was
#: rejected, and of the undamped one, most of which a weakly determined direction may promise.
NOISE, LOST = 1e-12, 1e-10
#: The undamped model may promise this many times what is enough for a damped step; a weakly determined direction,
#: which damping holds back, promises orders of magnitude more.
UNDAMPED = 10.0
MOST_ITERATIONS = 200

CONVERGED = "predicted decrease"
ROUNDING = "rounding"
#: A rejected step was the last, and the shorter one promises too little, though the minimum is not near.
EDGE = "the domain of the problem ends here"
STUCK, SINGULAR = "no step decreases the cost", "singular"
INVALID = "the start lies outside the domain of the problem"


@dataclass(frozen=True)
class Options:
    """When to stop.

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
    """

    tolerance: float | Array = 1e-14
    max_iterations: int | None = None
    max_seconds: float | None = None
    damping: float = START


@dataclass(frozen=True)
class Stats:
    """What the loop did with each of K members.

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
        """(K,) bool."""
        return (self.reasons == CONVERGED) | (self.reasons == ROUNDING)


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
        """Of residuals (K, N) and their derivatives (K, n, N)."""
        gradient = np.matmul(jacobian, residuals[..., None])[..., 0]
        cost = 0.5 * np.matmul(residuals[:, None], residuals[..., None])[:, 0, 0]
        return cls(cost, np.matmul(jacobian, jacobian.transpose(0, 2, 1)), gradient)


class Problem(Protocol):
    """What `minimise` takes: `count` independent problems of one kind.

    States and equations of several members are arrays, or named tuples of arrays, with the members along the first
    axis. Those of a problem with one member may be anything; its equations have a `cost` (1,).
    """

    count: int
    #: a cost (K,), or for all members, that rounding alone makes
    rounding: Any

    def linearise(self, state: Any, members: Array) -> Any:
        """Equations, with a `cost` (M,), of M members (indices) at their states (M, ...); inf outside the domain."""
        ...

    def solve(self, state: Any, equations: Any, damping: Array) -> tuple[Any, Array]:
        """Steps (M, ...) for λ (M,), and the decreases (M,) that (1) predicts; NaN where it cannot be solved."""
        ...

    def retract(self, state: Any, step: Any) -> Any:
        """The states that steps lead to."""
        ...

    def tried(self, trial: Trial) -> None:
        """Called after every trial of a problem with one member, to learn from it."""
        ...


class Small:
    """A problem whose state is an array (K, n) that steps are added to and whose equations are `Normal`."""

    count: int
    rounding: Any = 0.0

    def solve(self, state: Any, equations: Normal, damping: Array) -> tuple[Array, Array]:
        """See `damped_steps`."""
        return damped_steps(equations.matrix, equations.gradient, damping)

    def retract(self, state: Any, step: Array) -> Any:
        """Add the step."""
        return state + step

    def tried(self, trial: Trial) -> None:
        """Nothing is learnt."""


@dataclass(frozen=True)
class Trial:
    """A step that was tried: the equations before and after it, λ's predicted decrease, the gain."""

    iteration: int
    evaluations: int
    before: Any
    after: Any
    step: Any
    predicted: float
    gain: float  #: decrease of the cost over the predicted one
    accepted: bool


class Found(NamedTuple):
    """States and equations of all members where the loop ended, and what it did."""

    state: Any
    equations: Any
    stats: Stats


def minimise(problem: Problem, state: Any, options: Options | None = None) -> Found:
    """Minimise each member's cost from its state.

    A trial is linearised at once, as nearly all are accepted.
    """
    return _Run(problem, state, options or Options()).descend()


def negligible(part: float, observations: Array | float, unknowns: int) -> Array:
    """The tolerance that stops within `part` standard deviations of the minimum.

    A step δ along a parameter predicts ½ (δ/s)² σ², with the cost ½ (N − n) σ² of N residuals and n unknowns.
    """
    return part**2 / np.maximum(observations - unknowns, 1.0)


def damped_steps(matrix: Array, gradient: Array, damping: Array) -> tuple[Array, Array]:
    """Solve (1) for many small problems, their diagonals scaled to 1.

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
    scale = 1.0 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))  # a parameter that moves nothing stays
    scaled = matrix * scale[:, :, None]
    scaled *= scale[:, None, :]
    # the rounding of the products: a matrix that is singular but for it stays solvable
    scaled.reshape(count, n * n)[:, :: n + 1] = (1.0 + n * np.finfo(float).eps + damping)[:, None]
    right = gradient * scale
    unit = np.linalg.solve(scaled, right[..., None])[..., 0]
    predicted = 0.5 * (unit * (damping[:, None] * unit + right)).sum(1)
    unit *= -scale
    return unit, predicted


class _Damping:
    """λ of each member: it falls quickly, but cautiously for a while after a step that failed.

    The gain ratio ρ steers it as in H. B. Nielsen, Damping parameter in Marquardt's method (1999), eq. 2.5, times
    1 − (2ρ − 1)³, but from `GOOD` on it falls by `FALL`, as these problems start close by. In the curved, narrow valleys
    of the larger lens models λ would then be too small every other step, so it falls by `CAUTIOUS` until `CALM` steps
    have been taken since one failed. Of some dozen choices for the four on 150 refinements (simulated and real, opencv5
    to opencv14, kb4, ds), these took the fewest linearisations among those by which the most converged; others took
    up to a third more.
    """

    GOOD, FALL, CAUTIOUS, CALM, GROWTH = 0.75, 0.01, 0.5, 3, 10.0

    def __init__(self, start: Array):
        self.value = start
        self.growth = np.full(len(start), self.GROWTH)
        self.since_failure = np.full(len(start), self.CALM)

    def update(self, accepted: Array, gain: Array) -> None:
        """After a trial of all members."""
        fall = np.where(self.since_failure >= self.CALM, self.FALL, self.CAUTIOUS)
        good = gain > self.GOOD
        if good.all():  # as nearly always
            self.value = np.maximum(self.value * fall, SMALLEST)
            self.growth.fill(self.GROWTH)
            self.since_failure += 1
            return
        factor = np.where(good, fall, 1.0 - (2.0 * np.clip(gain, 0.0, 1.0) - 1.0) ** 3)
        self.value = np.maximum(self.value, SMALLEST) * np.where(accepted, factor, self.growth)
        self.growth = np.where(accepted, self.GROWTH, 2.0 * self.growth)
        self.since_failure = np.where(accepted, self.since_failure + 1, 0)

    def keep(self, rows: Array) -> None:
        self.value, self.growth, self.since_failure = (
            a[rows] for a in (self.value, self.growth, self.since_failure)
        )


class _Run:
    """The members that are under way, and the results of those that are done."""

    def __init__(self, problem: Problem, state: Any, options: Options):
        count = problem.count
        self.problem, self.options, self.begin = problem, options, time.perf_counter()
        self.members = np.arange(count)
        self.state, self.equations = state, problem.linearise(state, self.members)
        self.damping = _Damping(np.full(count, options.damping))
        self.tolerance = np.broadcast_to(options.tolerance, count)
        self.rounding = np.broadcast_to(problem.rounding, count)
        self.results: tuple[Any, Any] | None = None
        self.iteration, self.evaluated = 0, 1
        self.invalid = np.zeros(count, int)
        self.stats = Stats(*np.zeros((3, count), int), np.full(count, "", object))

    def descend(self) -> Found:
        """Iterate to the end."""
        limit = self.options.max_iterations
        reason = "iterations"
        for _ in range(MOST_ITERATIONS if limit is None else limit):
            if not len(self.members):
                break
            if self.late():
                reason = "time"
                break
            self.iterate()
        self.leave(np.ones(len(self.members), bool), reason)
        state, equations = (self.state, self.equations) if self.results is None else self.results
        return Found(state, equations, self.stats)

    def late(self) -> bool:
        """Whether `Options.max_seconds` have passed."""
        limit = self.options.max_seconds
        return limit is not None and time.perf_counter() - self.begin > limit

    def iterate(self) -> None:
        """One step of every member."""
        self.iteration += 1
        step, predicted = self.problem.solve(self.state, self.equations, self.damping.value)
        gone = self.arrived(predicted)
        if gone is not None:
            if gone.all():
                return
            step, predicted = rows_of(step, ~gone), predicted[~gone]
        solved = np.isfinite(predicted)
        if solved.any():
            accepted, gain = self.attempt(step, predicted)
        else:
            accepted, gain = solved, predicted
        self.damping.update(accepted, gain)
        if not accepted.all():
            self.failed(~accepted, predicted)

    def arrived(self, predicted: Array) -> Array | None:
        """Let members go whose step promises too little, or that never had any; the mask of those."""
        cost = self.equations.cost
        enough = self.tolerance * cost + self.rounding
        small = (predicted <= enough) & (cost < np.inf)
        lost = ~(np.isfinite(predicted) | (cost < np.inf))
        if not (small | lost).any():
            return None
        remaining = self.remaining(small, predicted)
        done = small & (remaining <= UNDAMPED * enough)
        rejected = small & ~done & (self.damping.since_failure == 0)
        rounding = rejected & (remaining <= LOST * cost)
        reasons = np.select([done, rounding, rejected, lost], [CONVERGED, ROUNDING, EDGE, INVALID], "")
        gone = reasons != ""
        self.leave(gone, reasons[gone])
        return gone

    def remaining(self, some: Array, damped: Array) -> Array:
        """The decreases that the model predicts without damping for some; the damped ones where it is unsolvable."""
        state, equations = rows_of(self.state, some), rows_of(self.equations, some)
        found = damped.copy()
        undamped = self.problem.solve(state, equations, np.zeros(int(some.sum())))[1]
        found[some] = np.where(np.isfinite(undamped), undamped, damped[some])
        return found

    def attempt(self, step: Any, predicted: Array) -> tuple[Array, Array]:
        """Try a step of each member and keep those that lower the cost; which these are, and their gains."""
        trial = self.problem.retract(self.state, step)
        after = self.problem.linearise(trial, self.members)
        self.evaluated += 1
        before, cost = self.equations, self.equations.cost
        with np.errstate(invalid="ignore", divide="ignore"):
            gain = (cost - after.cost) / predicted
        accepted = gain > LEAST_GAIN
        if accepted.all():
            self.state, self.equations = trial, after
        else:
            self.invalid += ~(after.cost < np.inf)
            self.state, self.equations = (
                merged(accepted, trial, self.state),
                merged(accepted, after, before),
            )
        if self.problem.count == 1:
            self.problem.tried(
                Trial(
                    self.iteration, self.evaluated, before, after, step, *predicted, *gain, bool(accepted[0])
                )
            )
        return accepted, gain

    def failed(self, rejected: Array, predicted: Array) -> None:
        """Let members go whose rejected step was the last."""
        cost = self.equations.cost
        tiny = rejected & (predicted <= NOISE * cost)
        rounding = tiny & (self.remaining(tiny, predicted) <= LOST * cost) if tiny.any() else tiny
        stuck = rejected & (self.damping.value > LARGEST)
        why = np.where(np.isfinite(predicted), STUCK, SINGULAR)
        reasons = np.select([rounding, stuck], [ROUNDING, why], "")
        self.leave(reasons != "", reasons[reasons != ""])

    def leave(self, gone: Array, reasons: Any) -> None:
        """Note the results of members and take them off the batch."""
        if not gone.any():
            return
        at = self.members[gone]
        self.stats.iterations[at], self.stats.evaluations[at] = self.iteration, self.evaluated
        self.stats.invalid[at], self.stats.reasons[at] = self.invalid[gone], reasons
        if self.results is None and not gone.all():
            self.results = copied(self.state), copied(self.equations)
        if self.results is not None:
            put(self.results[0], at, rows_of(self.state, gone))
            put(self.results[1], at, rows_of(self.equations, gone))
        stay = ~gone
        self.members, self.invalid = self.members[stay], self.invalid[stay]
        self.tolerance, self.rounding = self.tolerance[stay], self.rounding[stay]
        if not gone.all():
            self.state, self.equations = rows_of(self.state, stay), rows_of(self.equations, stay)
            self.damping.keep(stay)


# ---------------------------------------------------------------------------------------------- batches
def rows_of(batch: Any, mask: Array) -> Any:
    """Some members of an array or a named tuple of arrays; the same object where these are all."""
    if mask.all():
        return batch
    return batch[mask] if isinstance(batch, np.ndarray) else batch._make(a[mask] for a in batch)


def merged(mask: Array, new: Any, old: Any) -> Any:
    """Members of `new` where the mask, which does not say so of all, says so, else of `old`."""
    if not mask.any():
        return old
    if isinstance(new, np.ndarray):
        return np.where(mask.reshape(-1, *[1] * (new.ndim - 1)), new, old)
    return new._make(merged(mask, a, b) for a, b in zip(new, old, strict=True))


def copied(batch: Any) -> Any:
    """A copy that can be written to."""
    return batch.copy() if isinstance(batch, np.ndarray) else batch._make(a.copy() for a in batch)


def put(whole: Any, at: Array, part: Any) -> None:
    """Write members into a batch."""
    pairs = [(whole, part)] if isinstance(whole, np.ndarray) else zip(whole, part, strict=True)
    for a, b in pairs:
        a[at] = b
