"""Limits of the optimisers, each just below and just above; published numbers are those of the papers."""

from types import SimpleNamespace

import numpy as np
import pytest

from camcal.solve.optimizers import (
    conjugate_gradients,
    descent,
    dogleg,
    gauss_newton,
    lbfgs,
    leapfrog,
    line_search,
)
from camcal.solve.optimizers.base import NOISE, Options
from camcal.solve.problem import Step
from tests.sides import LESS, MORE
from tests.solve.problems import problem_of


# ------------------------------------------------------------------------------------ one variable
class Slope:
    """φ(α) of one variable from its value and derivative; inf outside the domain."""

    def __init__(self, cost, slope, noise=0.0):
        self.cost, self.slope, self.noise, self.asked = cost, slope, noise, []

    def at(self, x):
        return SimpleNamespace(x=x, cost=self.cost(x), gradient=np.array([self.slope(x)]))

    def move(self, place, step):
        x = float(place.x + step[0])
        self.asked.append(x)
        return None if np.isinf(self.cost(x)) else self.at(x)


def searched(variables, curvature=0.1, first=1.0):
    return line_search.strong_wolfe(variables, variables.at(0.0), np.array([1.0]), first, curvature)


@pytest.mark.parametrize(("share", "enough"), [(LESS, False), (MORE, True)])
def test_a_sufficient_decrease(share, enough):
    variables = Slope(lambda x: -x, lambda _: -1.0)
    search = line_search._Search(variables, variables.at(0.0), np.array([1.0]), 0.1)
    trial = line_search._Trial(2.0, -2 * share * line_search.SUFFICIENT, -1.0, None)
    assert search.decreases(trial) == enough


@pytest.mark.parametrize("growth", [LESS, MORE, 5.0])
def test_the_growth_of_a_length(growth):
    """Of a parabola with its minimum farther away than a length may grow, or not."""
    wanted = growth * line_search._MOST_GROWTH
    variables = Slope(lambda x: -x + x * x / wanted / 2, lambda x: -1 + x / wanted)
    searched(variables, curvature=1e-3)
    assert variables.asked[1] == pytest.approx(min(wanted, 10.0))


@pytest.mark.parametrize(("trials", "found"), [(line_search._TRIALS - 1, True), (line_search._TRIALS, False)])
def test_trials_until_the_domain_is_reached(trials, found):
    """Beyond the domain's end a length becomes a fifth of itself."""
    end = 0.2**trials * 1.01
    variables = Slope(lambda x: -x if x < end else np.inf, lambda _: -1.0)
    assert (searched(variables) is not None) == found


def test_a_bracket_that_is_narrow_enough():
    """Between a length and one that is longer by a part of itself no further trial is made."""
    for share, tried in ((LESS, 0), (MORE, 1)):
        variables = Slope(lambda x: -x, lambda _: -1.0)
        search = line_search._Search(variables, variables.at(0.0), np.array([1.0]), 2.0)
        low = line_search._Trial(1.0, -1.0, -1.0, variables.at(1.0))
        long = 1 / (1 - share * line_search._SHORTEST)
        search.zoom(low, line_search._Trial(long, np.inf, np.inf, None))
        assert len(variables.asked) == tried


# ------------------------------------------------------------------------------------ descent
def test_convergence_of_descent(monkeypatch):
    problem, state = problem_of("pinhole", count=3)
    for share, converged in ((LESS, True), (MORE, False)):

        def left(blocks, share=share):
            return share * (descent.LEAST_TOLERANCE * blocks.cost + problem.rounding)

        for module, minimise in ((descent, lbfgs.minimise), (leapfrog, leapfrog.minimise)):
            monkeypatch.setattr(module, "remaining", left)
            assert minimise(problem, state, Options(max_iterations=1)).converged == converged


def test_how_often_convergence_is_tested(monkeypatch):
    """By line searches before the first step and every fifth one; each test solves the normal equations."""
    problem, state = problem_of("pinhole", count=3)
    for module, minimise in ((descent, lbfgs.minimise), (leapfrog, leapfrog.minimise)):
        asked = []
        monkeypatch.setattr(module, "remaining", lambda _, a=asked: a.append(1) or 1.0)
        every = module._TEST_EVERY
        counts = []
        for steps in (every - 1, every, every + 1):
            asked.clear()
            done = minimise(problem, state, Options(max_iterations=steps))
            assert done.iterations == steps
            counts.append(len(asked))
        assert counts == ([2, 2, 3] if module is descent else [2, 3, 3])


def captured(monkeypatch, module, call):
    """The direction, the first length and the curvature that a method hands to `descend`."""
    monkeypatch.setattr(module, "descend", lambda *a: a[4:])
    return call()


def line_of(old, new, step):
    before, after = SimpleNamespace(gradient=np.asarray(old)), SimpleNamespace(gradient=np.asarray(new))
    return SimpleNamespace(before=before, after=after, step=np.asarray(step), direction=np.asarray(step))


def conjugate(monkeypatch):
    return captured(
        monkeypatch,
        conjugate_gradients,
        lambda: conjugate_gradients.conjugate_gradients(None, None, None, None, lambda *_: 1.0),
    )


@pytest.mark.parametrize("method", ["conjugate", "lbfgs"])
def test_slopes_that_end_a_line_search(monkeypatch, method):
    if method == "conjugate":
        curvature, limit = conjugate(monkeypatch)[2], conjugate_gradients.CURVATURE
    else:
        curvature, limit = (
            captured(monkeypatch, lbfgs, lambda: lbfgs.minimise(None, None))[2],
            lbfgs.CURVATURE,
        )
    for share, once in ((LESS, True), (MORE, False)):
        slope = -share * limit
        variables = Slope(lambda x, s=slope: -x + (s + 1) * x * x / 2, lambda x, s=slope: -1 + (s + 1) * x)
        searched(variables, curvature)
        assert (len(variables.asked) == 1) == once


def test_gradients_that_are_not_orthogonal(monkeypatch):
    for share, again in ((LESS, False), (MORE, True)):
        direction_of = conjugate(monkeypatch)[0]
        line = line_of([share * conjugate_gradients._ORTHOGONAL, 1.0], [1.0, 0.0], [0.0, 1.0])
        assert (direction_of(line) is None) == again


@pytest.mark.parametrize("unknowns", [2, 30])
def test_steps_between_two_restarts(monkeypatch, unknowns):
    direction_of = conjugate(monkeypatch)[0]
    one, other = np.eye(unknowns)[:2]
    steps = max(unknowns, conjugate_gradients._LEAST_STEPS)
    made = [direction_of(line_of(one, other, one)) for _ in range(steps)]
    assert [m is None for m in made] == [False] * (steps - 1) + [True]


def test_the_first_length_after_a_flat_slope():
    longest = conjugate_gradients._LONGEST
    for now in (LESS, MORE):
        line = line_of([-longest], [0.0], [now])
        place = SimpleNamespace(gradient=np.array([-1.0]))
        first = conjugate_gradients._first_length(line, place, np.array([1.0]))
        assert first == min(now * longest, 1e8)


def test_pairs_that_are_remembered(monkeypatch):
    """The curvature is 2 along each pair but the last one, and taken to be 1 where none is remembered."""
    direction_of = captured(monkeypatch, lbfgs, lambda: lbfgs.minimise(None, None))[0]
    axes = np.eye(lbfgs.MEMORY + 2)
    for i in range(lbfgs.MEMORY + 1):
        bend = 1.0 if i == lbfgs.MEMORY else 2.0
        direction = direction_of(line_of(axes[-1] - bend * axes[i], axes[-1], axes[i]))
        assert direction[-1] == pytest.approx(-1 / bend)
    full = [line_of(axes[0] + axes[1] - axes[-2], axes[0] + axes[1], axes[-2])]
    direction = direction_of(full[0])  # the pair of axis 1 goes as well
    assert direction[:3] == pytest.approx([-1, -1, 0])
    fresh = captured(monkeypatch, lbfgs, lambda: lbfgs.minimise(None, None))[0]
    for i in range(lbfgs.MEMORY):
        bend = 1.0 if i == lbfgs.MEMORY - 1 else 2.0
        direction = fresh(line_of(axes[0] - bend * axes[i], axes[0], axes[i]))
    assert direction[0] == pytest.approx(-0.5)


def test_a_change_of_the_gradient_that_is_rounding(monkeypatch):
    for share, kept in ((LESS, False), (MORE, True)):
        direction_of = captured(monkeypatch, lbfgs, lambda: lbfgs.minimise(None, None))[0]
        gradient = np.array([0.0, 1.0])
        direction = direction_of(line_of([-share * lbfgs.ROUNDING, 0.0], gradient, [1.0, 0.0]))
        assert np.array_equal(direction, -gradient) != kept


# ------------------------------------------------------------------------------------ leap-frog (Snyman 1983)
def particle(**more):
    place = SimpleNamespace(cost=1.0, gradient=np.array([1.0, 0.0]))
    return leapfrog._Particle(place, 1.0, np.array([0.1, 0.0]), 1.0, **more)


def test_the_growth_of_the_time_step():
    made = particle()
    made.control(None)
    made.control(None)
    assert made.factor == pytest.approx(1.002) and made.interval == pytest.approx(1.001 * 1.002)
    assert pytest.approx(0.001) == leapfrog.GROWTH


def test_accelerations_that_turn():
    for turned, interval in ((2, 1.001), (3, 0.5005)):
        made = particle(turned=turned)
        made.control(None)
        assert made.interval == pytest.approx(interval)


def test_steps_in_a_row_that_lose_speed():
    for slowed, rests in ((1, False), (2, True)):
        made = particle(slowed=slowed, last=np.array([0.1, 0.0]))
        made.back_half = lambda _, m=made: setattr(m.place, "gradient", np.zeros(2))
        made.velocity = np.array([2.0, 0.0])
        made.settle(None, made.place)
        assert (not made.velocity.any()) == rests


# ------------------------------------------------------------------------------------ Newton's methods
class Run:
    """A run whose steps have given gains; costs begin at 1."""

    def __init__(self, costs, enough=0.0, predicted=0.1):
        self.options, self.iteration = Options(max_iterations=len(costs)), 0
        self.recorder = SimpleNamespace(late=lambda: False)
        self.blocks, self.enough, self.costs = SimpleNamespace(cost=1.0), enough, list(costs)
        self.accepted, self.steps = [], []
        self.linear = SimpleNamespace(step=lambda *_: (Step(np.ones(1), np.ones((1, 6))), predicted))
        self.state = None

    def __call__(self, *_):
        return self

    def linearise(self, step):
        self.steps.append(step)
        cost = self.costs.pop(0) if not callable(self.costs[0]) else self.costs[0](step)
        return None, None if cost is None else SimpleNamespace(cost=cost)

    def accept(self, _, blocks):
        self.accepted.append(blocks.cost)

    def ended(self, converged, reason):
        return SimpleNamespace(converged=converged, stop_reason=reason)


def trusted(monkeypatch, costs, predicted=0.1, newton=0.2, enough=0.0):
    """A run of dogleg steps of length 1; the radii they are given follow."""
    run, radii = Run(costs, enough), []
    model = SimpleNamespace(newton=np.ones(1), newton_length=2.0, newton_predicted=newton, scale=1.0)
    model.step = lambda radius: radii.append(radius) or (np.array([1.0]), predicted)
    monkeypatch.setattr(dogleg, "NewtonRun", run)
    monkeypatch.setattr(dogleg, "_Model", lambda *_: model)
    monkeypatch.setattr(dogleg.tangent, "sizes", lambda _: (1,))
    monkeypatch.setattr(dogleg.tangent, "unflat", lambda x, _: x)
    monkeypatch.setattr(dogleg, "remaining", lambda _: 1.0)
    return dogleg.minimise(None, None), run, radii


@pytest.mark.parametrize(
    ("gain", "radius"),
    [
        (LESS * dogleg._POOR, 0.25),
        (MORE * dogleg._POOR, 4.0),
        (LESS * dogleg._GOOD, 4.0),
        (MORE * dogleg._GOOD, 4.0),
    ],
)
def test_the_region_after_a_step(monkeypatch, gain, radius):
    """Nocedal & Wright's ratios; the region begins at twice the length of Newton's step."""
    radii = trusted(monkeypatch, [1 - 0.1 * gain, 1.0])[2]
    assert radii == [4.0, radius]


def test_the_region_grows_to_three_steps(monkeypatch):
    """After it has shrunk to a quarter."""
    for share, last in ((LESS, 0.25), (MORE, 3.0)):
        gains = [0.1, share * dogleg._GOOD, 0.0]
        assert trusted(monkeypatch, [1 - 0.1 * g for g in gains])[2] == [4.0, 0.25, last]


def test_steps_of_dogleg_that_are_accepted(monkeypatch):
    for share, accepted in ((LESS, 0), (MORE, 1)):
        assert len(trusted(monkeypatch, [1 - 0.1 * share * dogleg._ACCEPTED])[1].accepted) == accepted


def test_a_region_that_has_collapsed(monkeypatch):
    for share, tried in ((LESS, 0), (MORE, 1)):
        run = trusted(monkeypatch, [0.9], predicted=share * dogleg._SHRUNK * 0.1, enough=0.1)[1]
        assert len(run.steps) == tried


@pytest.mark.parametrize("part", ["step", "newton"])
def test_a_rejected_step_that_is_rounding(monkeypatch, part):
    for share, reason in ((LESS, "rounding"), (MORE, "iterations")):
        sizes = {"predicted": LESS * NOISE, "newton": LESS * NOISE / dogleg._OF_NEWTON}
        sizes["predicted" if part == "step" else "newton"] *= share / LESS
        assert trusted(monkeypatch, [1.0], **sizes)[0].stop_reason == reason


def test_steps_of_gauss_newton_that_decrease_enough(monkeypatch):
    for share, accepted in ((LESS, 0), (MORE, 1)):
        run = Run([1 - share * gauss_newton._SUFFICIENT * 2 * 0.1] + [1.0] * gauss_newton._HALVINGS)
        run.options = Options(max_iterations=1)
        monkeypatch.setattr(gauss_newton, "NewtonRun", run)
        gauss_newton.minimise(None, None)
        assert len(run.accepted) == accepted


def test_steps_of_gauss_newton_that_are_halved(monkeypatch):
    """The last of thirty lengths is 2⁻²⁹ of a step."""
    last = 0.5 ** (gauss_newton._HALVINGS - 1)
    for end, accepted in ((1.01 * last, 1), (0.99 * last, 0)):
        run = Run([lambda step, end=end: 0.5 if step.intrinsics[0] < end else None])
        monkeypatch.setattr(gauss_newton, "NewtonRun", run)
        gauss_newton.minimise(None, None)
        assert len(run.accepted) == accepted


def test_a_step_of_gauss_newton_that_is_rounding(monkeypatch):
    for share, reason in ((LESS, "rounding"), (MORE, "no step decreases the cost")):
        run = Run([lambda _: 2.0], predicted=share * NOISE)
        monkeypatch.setattr(gauss_newton, "NewtonRun", run)
        assert gauss_newton.minimise(None, None).stop_reason == reason
