"""Levenberg-Marquardt: the least-squares loop (camcal.least_squares) on the Schur complement."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from camcal import least_squares
from camcal.least_squares import EDGE, Trial
from camcal.solve.linear import FORMS as VARIANTS
from camcal.solve.linear import Linear
from camcal.solve.optimizers.base import OnStep, Options, Recorder, Result, Sample, begin
from camcal.solve.optimizers.curvature import Curvature
from camcal.solve.problem import Blocks, Problem, State, Step
from camcal.solve.schur import Reduced
from camcal.solve.stack import Stack

__all__ = ["VARIANTS", "minimise", "minimise_together"]

Array = np.ndarray

#: easy problems have converged by then and avoid the cost of what follows
_LEARN_FROM = 8
#: of the distortion, with which a run is restarted
_FACTORS = (-1.0, -0.5)
#: Decrease of chi² in ten steps at the end of a valley; at one sigma chi² increases by 1. With 1e-3 the descent for 50
#: views of 54 points with opencv8 ended 11 above the minimum that it reaches with 1e-4.
STILL_CHI2 = 1e-4
#: a converged run is preferred to one that was stopped even if its cost is larger by this fraction
_NEARLY = 1e-3


def minimise(
    problem: Problem, state: State, options: Options | None = None, on_step: OnStep | None = None
) -> Result:
    """Minimise the problem's cost from a state.

    If it is stopped by the limit of the lens's domain, it restarts with the distortion negated
    (see `_elsewhere`).

    Raises
    ------
    EstimationError
        If the start itself cannot be projected.
    """
    options = options or Options()
    found = _descend(problem, state, options, on_step)
    if found.stop_reason != EDGE:
        return found
    for start in _elsewhere(problem, found.state):
        found = _joined(found, _descend(problem, start, options, None))
        if found.converged:
            break
    return found


def minimise_together(
    problems: Sequence[Problem], states: Sequence[State], options: Options | None = None
) -> list[Result | None]:
    """Minimise the costs of many problems as members of one batch; they have to fit into a `Stack`.

    None for members that `minimise` treats in a way of its own: those that have not converged before it learns
    curvature, that orthogonal factors have to solve, that the limit of the lens's domain stops, and whose start cannot
    be projected. The result of a member does not depend on the others.
    """
    options = options or Options()
    stack = Stack(problems)
    found = least_squares.minimise(stack, stack.state(states), replace(options, max_iterations=_LEARN_FROM))
    settled = found.stats.converged & ~stack.alone
    return [stack.result(found, i) if settled[i] else None for i in range(len(problems))]


def _descend(problem: Problem, state: State, options: Options, on_step: OnStep | None) -> Result:
    """One descent from a start."""
    coordinates = 2 * sum(
        len(view) for view in problem.views
    )  # chi² at the minimum, apart from the parameters
    options = replace(options, still=STILL_CHI2 / max(coordinates, 1))
    whole = _Whole(problem, state, options, on_step)
    found = least_squares.minimise(whole, state, options)
    stats = found.stats
    return Result(
        found.state,
        found.equations.blocks,
        bool(stats.converged[0]),
        str(stats.reasons[0]),
        int(stats.iterations[0]),
        int(stats.evaluations[0]) + whole.linear.passes,
        tuple(whole.recorder.samples),
        whole.linear.info(),
    )


class _Linearised(NamedTuple):
    """The output of `Problem.linearise`; infinite cost if it has no blocks."""

    cost: Array
    blocks: Blocks | None

    @classmethod
    def of(cls, blocks: Blocks | None) -> _Linearised:
        return cls(np.array([np.inf if blocks is None else blocks.cost]), blocks)


class _Whole:
    """A calibration as the only member of a batch; it learns curvature from the accepted steps."""

    count = 1

    def __init__(self, problem: Problem, state: State, options: Options, on_step: OnStep | None):
        self.problem, self.retract, self.rounding = problem, problem.retract, problem.rounding
        self.linear = Linear(problem, options.variant)
        first = begin(problem, state)
        self.first: _Linearised | None = _Linearised.of(first)
        self.recorder = Recorder(first.cost, 1, on_step, options)
        self.curvature = Curvature(len(first.gradient))
        self.used_curvature = False
        self.undamped: Reduced | None = None  # at the state, where the curvature is learnt

    def linearise(self, state: State, members: Array) -> _Linearised:
        """The normal equations by blocks."""
        if self.first is not None:
            first, self.first = self.first, None
            return first
        return _Linearised.of(self.problem.linearise(state))

    def solve(self, state: State, equations: _Linearised, damping: Array) -> tuple[Step | None, Array]:
        """Solve with the learnt curvature if it is reliable, except for the undamped model, which predicts the
        remaining decrease.
        """
        blocks, value = equations.blocks, float(damping[0])
        assert blocks is not None
        solved, self.used_curvature = None, self.curvature.trusted and value > 0
        if self.used_curvature:
            solved = self.linear.step(state, blocks, value, self.curvature.matrix)
        if solved is None:
            self.used_curvature = False
            solved = self.linear.step(state, blocks, value)
        return (None, np.array([np.nan])) if solved is None else (solved[0], np.array([solved[1]]))

    def tried(self, trial: Trial) -> None:
        """Record and learn."""
        if not trial.accepted[0]:
            self.curvature.trusted = False
            return
        if trial.iteration >= _LEARN_FROM:
            self.learn(trial)
        cost = float(trial.after.cost[0])
        self.recorder.add(trial.iteration, cost, trial.evaluations + self.linear.passes)

    def learn(self, trial: Trial) -> None:
        """Update the curvature, and use it if it would have predicted this decrease better."""
        scaled, own = self.problem.normalise, trial.step.intrinsics
        before = self.undamped or Reduced(trial.before.blocks, 0.0, scaled)
        after = Reduced(trial.after.blocks, 0.0, scaled)
        self.undamped = None
        if not (before.solvable and after.solvable):
            self.curvature.trusted = False
            return
        predicted = float(trial.predicted[0])
        actual = float(trial.gain[0]) * predicted
        extra = self.curvature.along(own)
        without, with_ = (
            (predicted + extra, predicted) if self.used_curvature else (predicted, predicted - extra)
        )
        self.curvature.learn(own, before, after)
        self.curvature.trusted = abs(actual - with_) <= abs(actual - without)
        self.undamped = after


def _elsewhere(problem: Problem, state: State) -> Iterator[State]:
    """Starts beyond a fold or a pole of the lens that stopped a run.

    In over-parameterised models, distortion may push its pole against the outermost points; with its sign
    reversed, poles vanish or move, and so does the minimum that is reached from there.
    """
    own = [i for i, p in enumerate(problem.parameters) if p.group == "distortion" and problem.free[i].any()]
    for factor in _FACTORS:
        params = state.params.copy()
        params[own] *= factor
        start = replace(state, params=params)
        if problem.linearise(start) is not None:
            yield start


def _joined(first: Result, second: Result) -> Result:
    """The better of two runs, with the combined work of both."""
    better = second if second.blocks.cost < first.blocks.cost else first
    if second.converged and second.blocks.cost <= (1 + _NEARLY) * first.blocks.cost:
        better = second
    samples, done = list(first.samples), first.samples[-1]
    if better is second:
        samples += [
            Sample(
                first.iterations + s.iteration,
                s.cost,
                first.evaluations + s.evaluations,
                done.seconds + s.seconds,
            )
            for s in second.samples
            if s.cost < done.cost
        ]
    return replace(
        better,
        iterations=first.iterations + second.iterations,
        evaluations=first.evaluations + second.evaluations,
        samples=tuple(samples),
        info={**better.info, "restarts": first.info.get("restarts", 0) + 1},
    )
