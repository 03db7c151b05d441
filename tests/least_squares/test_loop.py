"""The loop's decisions, each from both sides, on problems whose costs are written down; then real ones."""

from typing import NamedTuple

import numpy as np
import pytest

from camcal.least_squares import EDGE, Normal, Options, Small, minimise, negligible
from camcal.least_squares.problem import CONVERGED, INVALID, ROUNDING, SINGULAR, STILL, STUCK

# written out once more: a test of a decision has to notice where the number that decides it has changed
LEAST_GAIN, NOISE, LOST, UNDAMPED, STEADY = 1e-4, 1e-12, 1e-10, 10.0, 0.01


class Scripted(Small):
    """One parameter, JᵀJ = 1 and the gradients and costs of a list, one pair an evaluation; the last one lasts."""

    def __init__(self, *pairs, rounding=0.0):
        self.count, self.rounding, self.pairs, self.seen, self.trials = 1, rounding, list(pairs), 0, []

    def linearise(self, state, members):
        cost, gradient = self.pairs[min(self.seen, len(self.pairs) - 1)]
        self.seen += 1
        return Normal(np.array([cost]), np.ones((1, 1, 1)), np.array([[gradient]]))

    def tried(self, trial):
        self.trials.append(trial)


def run(problem, **options):
    found = minimise(problem, np.zeros((1, 1)), Options(**{"tolerance": 0.0, "damping": 1e-12} | options))
    return found.stats.reasons[0], found


# ------------------------------------------------------------------------------- the predicted decrease is 1/2 g²
@pytest.mark.parametrize(("factor", "reason"), [(0.999, "iterations"), (1.001, CONVERGED)])
def test_converged_by_the_part_of_the_cost(factor, reason):
    problem = Scripted((4.0, 0.1), (3.999, 0.1))
    assert run(problem, tolerance=factor * 0.5 * 0.1**2 / 4.0, max_iterations=1)[0] == reason


@pytest.mark.parametrize(("factor", "reason"), [(0.999, "iterations"), (1.001, CONVERGED)])
def test_converged_at_the_rounding_of_the_problem(factor, reason):
    problem = Scripted((4.0, 0.1), (3.999, 0.1), rounding=factor * 0.5 * 0.1**2)
    assert run(problem, max_iterations=1)[0] == reason


@pytest.mark.parametrize(("share", "accepted"), [(0.9 * LEAST_GAIN, False), (1.1 * LEAST_GAIN, True)])
def test_steps_are_accepted_by_their_gain(share, accepted):
    problem = Scripted((1.0, 1.0), (1.0 - 0.5 * share, 1.0))
    _, found = run(problem, max_iterations=1)
    assert problem.trials[0].accepted[0] == accepted
    assert problem.trials[0].gain[0] == pytest.approx(share, rel=1e-6)
    assert (found.state != 0).all() == accepted
    assert found.equations.cost[0] == (1.0 if not accepted else 1.0 - 0.5 * share)


@pytest.mark.parametrize(("ratio", "reason"), [(0.9 * UNDAMPED, CONVERGED), (1.1 * UNDAMPED, "iterations")])
def test_a_damped_step_that_promises_little_is_no_convergence(ratio, reason):
    """Undamped over damped prediction is (1 + λ)² / (1 + 2 λ) with one parameter."""
    damping = ratio - 1 + np.sqrt(ratio**2 - ratio)
    damped = 0.5 * (1 + 2 * damping) / (1 + damping) ** 2
    problem = Scripted((4.0, 1.0), (4.0 - 0.9 * damped, 1.0))
    assert run(problem, tolerance=1.0001 * damped / 4.0, damping=damping, max_iterations=1)[0] == reason


def test_the_end_of_the_domain_is_a_rejected_step_before_one_that_promises_too_little():
    problem = Scripted((1.0, 1.0), (np.inf, 0.0))
    # λ grows 10, 200, ...: the step of the third iteration promises less than 1e-2
    reason, found = run(problem, tolerance=1e-2, damping=1.0)
    assert reason == EDGE and not found.stats.converged[0]
    assert found.stats.invalid[0] == found.stats.evaluations[0] - 1 == 2
    # with the steps before it accepted, the same promise is a damping that has still to fall
    going = Scripted((1.0, 1.0), (1.0 - 1e-3, 1.0))
    assert run(going, tolerance=1e-2, damping=200.0, max_iterations=1)[0] == "iterations"


# ------------------------------------------------------------------------------------------------------- rounding
@pytest.mark.parametrize(("share", "reason"), [(0.9, ROUNDING), (1.1, "iterations")])
def test_a_rejected_step_may_be_rounding(share, reason):
    gradient = np.sqrt(2 * share * NOISE * 4.0)
    assert run(Scripted((4.0, gradient)), max_iterations=1)[0] == reason


@pytest.mark.parametrize(("share", "reason"), [(0.9, ROUNDING), (1.1, "iterations")])
def test_rounding_asks_what_remains_without_damping(share, reason):
    gradient = np.sqrt(2 * share * LOST * 4.0)
    assert run(Scripted((4.0, gradient)), damping=1e4, max_iterations=1)[0] == reason


@pytest.mark.parametrize(("share", "reason"), [(0.9, ROUNDING), (1.1, EDGE)])
def test_rounding_is_told_from_the_end_of_the_domain(share, reason):
    gradient = np.sqrt(2 * share * LOST)
    # the first step is rejected above the noise, the second, with λ ten times as large, promises next to nothing
    found = run(Scripted((1.0, gradient)), damping=60.0, tolerance=1e-12, max_iterations=2)
    assert found[0] == reason


# --------------------------------------------------------------------------------------------------------- valleys
@pytest.mark.parametrize(
    ("still", "reason"), [(0.0, "iterations"), (0.99e-6, "iterations"), (1.01e-6, STILL)]
)
def test_a_valley_is_ten_steps_that_hardly_lower_the_cost(still, reason):
    slow = [(1.0 - 1e-7 * i, np.sqrt(2e-7)) for i in range(30)]
    said, found = run(Scripted(*slow), still=still, max_iterations=25)
    assert said == reason and found.stats.converged[0] == (reason == STILL)
    assert found.stats.iterations[0] == (20 if reason == STILL else 25)


@pytest.mark.parametrize(("part", "reason"), [(0.9 * STEADY, "iterations"), (1.1 * STEADY, STILL)])
def test_a_quick_descent_is_no_valley(part, reason):
    quick = [(1.0 - 1e-7 * i, np.sqrt(2e-6 * part)) for i in range(30)]
    assert run(Scripted(*quick), still=1.01e-6, max_iterations=25)[0] == reason


@pytest.mark.parametrize(
    ("rejected", "still", "reason"), [(2, 1e-6, STILL), (3, 1e-6, EDGE), (3, 1e-7, "iterations")]
)
def test_the_end_of_the_domain_is_no_valley(rejected, still, reason):
    costs = [1.0 - 1e-10 * i for i in range(30)]
    for i in range(rejected):
        costs.insert(12 + 2 * i, np.inf)
    said, found = run(Scripted(*((c, np.sqrt(2e-10)) for c in costs)), still=still, max_iterations=25)
    assert said == reason and found.stats.converged[0] == (reason == STILL)


# ------------------------------------------------------------------------------------------------------------ ends
def test_ends_where_no_step_helps():
    reason, found = run(Scripted((1.0, 1.0)), damping=1.0)
    assert reason == STUCK and not found.stats.converged[0]
    assert found.state[0, 0] == 0 and found.stats.invalid[0] == 0
    # λ = 10, 200, 8e3, 6.4e5, 1e8, 3.3e10, 2.1e13 > 1e12
    assert found.stats.iterations[0] == 7 and found.stats.evaluations[0] == 8


def test_ends_after_two_hundred_steps():
    slow = [(1.0 - 1e-3 * i, 1.0) for i in range(300)]
    reason, found = run(Scripted(*slow))
    assert reason == "iterations" and found.stats.iterations[0] == 200


def test_equations_that_cannot_be_solved():
    class Unsolvable(Scripted):
        def solve(self, state, equations, damping):
            return np.full((1, 1), np.nan), np.array([np.nan])

    problem = Unsolvable((1.0, 1.0))
    assert run(problem)[0] == SINGULAR and problem.seen == 1
    assert run(Unsolvable((np.inf, 1.0)))[0] == INVALID


def test_a_start_outside_the_domain_may_come_back():
    reason, found = run(Scripted((np.inf, 1.0), (0.5, 0.0)))
    assert reason == CONVERGED and found.equations.cost[0] == 0.5


def test_no_time_and_no_iterations():
    assert run(Scripted((1.0, 1.0), (0.5, 0.0)), max_seconds=0.0)[0] == "time"
    assert run(Scripted((1.0, 1.0), (0.5, 0.0)), max_seconds=100.0)[0] == CONVERGED
    reason, found = run(Scripted((1.0, 1.0)), max_iterations=0)
    assert reason == "iterations" and found.stats.evaluations[0] == 1 and found.stats.iterations[0] == 0


def test_negligible_is_a_part_of_a_standard_deviation():
    """Of a line through N points: the cost rises by ½ part² σ² where the slope is off by part of its sigma."""
    rng = np.random.default_rng(0)
    x, y = np.linspace(-1, 1, 50), rng.normal(size=50)
    design = np.c_[x, np.ones(50)]
    best = np.linalg.lstsq(design, y, rcond=None)[0]
    cost = 0.5 * ((y - design @ best) ** 2).sum()
    sigma = np.sqrt(2 * cost / 48 * np.linalg.inv(design.T @ design)[0, 0])
    off = 0.5 * ((y - design @ (best + [0.1 * sigma, 0.0])) ** 2).sum() - cost
    assert off == pytest.approx(negligible(0.1, 50.0, 2) * cost, rel=1e-9)
    assert negligible(0.1, 2.0, 2) == negligible(0.1, 3.0, 2) == pytest.approx(0.01)


# ---------------------------------------------------------------------------------------------------- real batches
class Decay(NamedTuple):
    """y = amplitude exp(-rate t), by two arrays (K, 1)."""

    amplitude: np.ndarray
    rate: np.ndarray


class Decays(Small):
    t = np.linspace(0, 2, 30)

    def __init__(self, y):
        self.y, self.count, self.asked = y, len(y), []

    def linearise(self, state, members):
        self.asked.append(members)
        with np.errstate(over="ignore"):
            e = np.exp(-state.rate * self.t)
        normal = Normal.of(
            state.amplitude * e - self.y[members], np.stack([e, -state.amplitude * self.t * e], 1)
        )
        return normal._replace(cost=np.where(state.rate[:, 0] > 0, normal.cost, np.inf))

    def retract(self, state, step):
        return Decay(state.amplitude + step[:, :1], state.rate + step[:, 1:])


def decays(count=6, noise=0.01):
    rng = np.random.default_rng(2)
    truth = Decay(rng.uniform(1, 3, (count, 1)), rng.uniform(0.2, 4, (count, 1)))
    y = truth.amplitude * np.exp(-truth.rate * Decays.t)
    return truth, y + rng.normal(0, noise, y.shape)


def test_members_go_their_own_ways():
    truth, y = decays()
    problem = Decays(y)
    start = Decay(np.ones_like(truth.rate), np.ones_like(truth.rate))
    found = minimise(problem, start)
    assert found.stats.converged.all()
    np.testing.assert_allclose(found.state.rate, truth.rate, rtol=0.05)
    assert len(set(found.stats.iterations)) > 1  # they leave one after the other
    sizes = [len(m) for m in problem.asked]
    assert sizes[0] == 6 and sizes == sorted(sizes, reverse=True) and sizes[-1] < 6
    for k in range(6):
        own = Decays(y[k : k + 1])
        alone = minimise(own, Decay(*(a[k : k + 1] for a in start)))
        np.testing.assert_allclose(alone.state.rate[0], found.state.rate[k], rtol=1e-12)
        assert len(own.asked) == found.stats.evaluations[k] == alone.stats.evaluations[0]
        assert found.equations.cost[k] == pytest.approx(alone.equations.cost[0], rel=1e-12)
        assert alone.stats.iterations[0] == found.stats.iterations[k]
    assert (start.rate == 1).all()  # the start is the caller's


def test_a_member_without_a_chance_does_not_stop_the_others():
    _, y = decays(3)
    y[1] = np.nan
    found = minimise(Decays(y), Decay(np.ones((3, 1)), np.ones((3, 1))))
    assert list(found.stats.converged) == [True, False, True]
    assert found.stats.reasons[1] == INVALID


def test_steps_out_of_the_domain_are_counted():
    _, y = decays(1, noise=0.0)
    found = minimise(Decays(y), Decay(np.array([[3.0]]), np.array([[30.0]])))
    assert found.stats.converged[0] and found.stats.invalid[0] > 0


def test_rosenbrock():
    """The banana valley: ½ (10 (y - x²))² + ½ (1 - x)², whose minimum is 0 at (1, 1)."""

    class Banana(Small):
        rounding = 1e-30

        def __init__(self, count):
            self.count = count

        def linearise(self, state, members):
            x, y = state.T
            one, zero = np.ones_like(x), np.zeros_like(x)
            rows = np.stack([np.stack([-20 * x, 10 * one], -1), np.stack([-one, zero], -1)], 2)
            return Normal.of(np.stack([10 * (y - x**2), 1 - x], 1), rows)

    starts = np.array([[-1.2, 1.0], [5.0, -5.0], [0.0, 0.0], [1.0, 1.0]])
    found = minimise(Banana(4), starts)
    assert found.stats.converged.all() and (found.stats.iterations < 60).all()
    np.testing.assert_allclose(found.state, np.ones((4, 2)), atol=1e-12)
    assert found.stats.evaluations[3] == 1  # begun at the minimum
