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
from typing import Any

import numpy as np

from camcal.least_squares.batch import copied, merged, put, rows_of
from camcal.least_squares.damping import LARGEST, SMALLEST, Damping
from camcal.least_squares.problem import (
    CONVERGED,
    EDGE,
    INVALID,
    ROUNDING,
    SINGULAR,
    STILL,
    STUCK,
    Found,
    Options,
    Problem,
    Stats,
    Trial,
)

Array = np.ndarray

#: accepted are steps that bring more than this part of what the model predicts (Moré 1978, section 5)
LEAST_GAIN = 1e-4
#: Predicted decreases below these parts of the cost are lost in the rounding of its sum: of a damped step that was
#: rejected, and of the undamped one, most of which a weakly determined direction may promise.
NOISE, LOST = 1e-12, 1e-10
#: The undamped model may promise this many times what is enough for a damped step; a weakly determined direction,
#: which damping holds back, promises orders of magnitude more.
UNDAMPED = 10.0
#: steps over which the fall of the cost is compared with `Options.still`; more than `FEW` rejected ones among them are
#: the end of the domain, not a valley, and so that no slow but steady approach to it is cut short, that asks for a fall
#: smaller by `CLOSER`
WATCHED, FEW, CLOSER = 10, 2, 1e-3
#: the next step promises at least this part of that fall: of predictions that fall by more than a third each time it is
#: less, and these converge
STEADY = 0.01
MOST_ITERATIONS = 200  #: a limit of work: a descent that reaches it ends as not converged


def minimise(problem: Problem, state: Any, options: Options | None = None) -> Found:
    """Minimise each member's cost from its state.

    A trial is linearised at once, as nearly all are accepted.
    """
    return _Run(problem, state, options or Options()).descend()


class _Run:
    """The members still being iterated, and the results of the finished ones."""

    def __init__(self, problem: Problem, state: Any, options: Options):
        count = problem.count
        self.problem, self.options, self.begin = problem, options, time.perf_counter()
        self.members = np.arange(count)
        self.state, self.equations = state, problem.linearise(state, self.members)
        self.damping = Damping(np.full(count, options.damping))
        self.tolerance = np.broadcast_to(options.tolerance, count)
        self.rounding = np.broadcast_to(problem.rounding, count)
        self.before = np.zeros(count)  # what was predicted of the step before, if that was accepted
        self.watched, self.rejected = np.full(count, np.inf), np.zeros(count, int)  # for `settled`
        self.results: tuple[Any, Any] | None = None
        self.iteration, self.evaluated = 0, 1
        self.invalid = np.zeros(count, int)
        iterations, evaluations, invalid = np.zeros((3, count), int)
        self.stats = Stats(iterations, evaluations, invalid, np.full(count, "", object))

    def descend(self) -> Found:
        """Iterate until every member is finished."""
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
        """Return whether `Options.max_seconds` have passed."""
        limit = self.options.max_seconds
        return limit is not None and time.perf_counter() - self.begin > limit

    def iterate(self) -> None:
        """Take one step of every member."""
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
        self.before = predicted if accepted.all() else np.where(accepted, predicted, 0.0)
        self.damping.update(accepted, gain)
        if not accepted.all():
            self.rejected += ~accepted
            self.failed(~accepted, predicted)
        if self.options.still and self.iteration % WATCHED == 0 and len(self.members):
            self.settled()

    def settled(self) -> None:
        """Finish members whose cost hardly fell over the last steps: see `Options.still`."""
        cost, before = self.equations.cost, self.before
        fall = self.watched - cost
        steady = (before >= STEADY * fall) & (fall < np.inf)
        valley = steady & (fall <= self.options.still * cost) & (self.rejected <= FEW)
        edge = steady & (fall <= CLOSER * self.options.still * cost) & (self.rejected > FEW)
        self.watched, self.rejected = cost, np.zeros(len(cost), int)
        reasons = np.select([valley, edge], [STILL, EDGE], "")
        self.leave(reasons != "", reasons[reasons != ""])

    def arrived(self, predicted: Array) -> Array | None:
        """Finish members whose step predicts too small a decrease, or that have none; return the mask of those."""
        cost = self.equations.cost
        with np.errstate(invalid="ignore"):  # 0 times inf
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
        if not gone.any():
            return None
        self.leave(gone, reasons[gone])
        return gone

    def remaining(self, some: Array, damped: Array) -> Array:
        """Return the undamped predicted decreases of some members; the damped ones where the undamped system is
        singular, and where λ is too small to change a digit.
        """
        some = some & (self.damping.value > SMALLEST)
        if not some.any():
            return damped
        state, equations = rows_of(self.state, some), rows_of(self.equations, some)
        found = damped.copy()
        undamped = self.problem.solve(state, equations, np.zeros(int(some.sum())))[1]
        found[some] = np.where(np.isfinite(undamped), undamped, damped[some])
        return found

    def attempt(self, step: Any, predicted: Array) -> tuple[Array, Array]:
        """Try a step of each member and keep those that lower the cost; return the mask of these and their gains."""
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
        where = self.iteration, self.evaluated, self.members
        self.problem.tried(Trial(*where, before, after, step, predicted, gain, accepted))
        return accepted, gain

    def failed(self, rejected: Array, predicted: Array) -> None:
        """Finish members whose last allowed step was rejected."""
        cost = self.equations.cost
        tiny = rejected & (predicted <= NOISE * cost)
        rounding = tiny & (self.remaining(tiny, predicted) <= LOST * cost)
        stuck = rejected & (self.damping.value > LARGEST)
        why = np.where(np.isfinite(predicted), STUCK, SINGULAR)
        reasons = np.select([rounding, stuck], [ROUNDING, why], "")
        self.leave(reasons != "", reasons[reasons != ""])

    def leave(self, gone: Array, reasons: Any) -> None:
        """Record the results of members and remove them from the batch."""
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
        self.before, self.watched, self.rejected = (
            a[stay] for a in (self.before, self.watched, self.rejected)
        )
        if not gone.all():
            self.state, self.equations = rows_of(self.state, stay), rows_of(self.equations, stay)
            self.damping.keep(stay)
