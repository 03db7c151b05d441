"""λ, damped steps and batches."""

from typing import NamedTuple

import numpy as np
import pytest

from camcal.least_squares import Differences, Normal, Options, blocks, damped_steps, minimise
from camcal.least_squares.batch import copied, merged, put, rows_of
from camcal.least_squares.damping import Damping

YES, NO = np.array([True]), np.array([False])


def after(*gains, start=1.0):
    """λ after steps of these gains, None = rejected."""
    damping, values = Damping(np.array([start])), []
    for gain in gains:
        damping.update(NO if gain is None else YES, np.array([np.nan if gain is None else gain]))
        values.append(damping.value[0])
    return values


@pytest.mark.parametrize(
    ("gain", "factor"),
    [(1.0, 0.01), (2.0, 0.01), (0.76, 0.01), (0.74, 1 - 0.48**3), (0.5, 1.0), (0.25, 1.125), (0.001, 1.994)],
)
def test_the_gain_steers_the_damping(gain, factor):
    assert after(gain)[0] == pytest.approx(factor, rel=1e-3)


def test_rejected_steps_raise_it_faster_each_time():
    assert after(None, None, None) == pytest.approx([10, 200, 8000])
    # one accepted step, and the growth begins anew
    assert after(None, 0.5, None) == pytest.approx([10, 10, 100])
    assert after(None, None, 1.0, None)[-1] == pytest.approx(200 * 0.5 * 10)


def test_after_a_failure_it_falls_cautiously_for_three_steps():
    assert after(None, 1, 1, 1, 1, 1) == pytest.approx([10, 5, 2.5, 1.25, 0.0125, 0.000125])


def test_it_does_not_fall_below_what_changes_a_digit():
    assert after(*[1.0] * 12)[-1] == 1e-14
    # and rises from there
    assert after(None, start=0.0)[-1] == pytest.approx(1e-13)


def test_members_have_their_own():
    damping = Damping(np.ones(3))
    damping.update(np.array([True, False, True]), np.array([1.0, np.nan, 0.5]))
    np.testing.assert_allclose(damping.value, [0.01, 10, 1])
    damping.keep(np.array([False, True, True]))
    damping.update(np.array([True, True]), np.ones(2))
    np.testing.assert_allclose(damping.value, [5, 0.01])


def test_a_member_does_not_depend_on_the_others():
    """Down to the least λ, where a step of another member is rejected."""
    alone, company = Damping(np.ones(1)), Damping(np.ones(2))
    for _ in range(9):
        alone.update(np.array([True]), np.ones(1))
        company.update(np.array([True, False]), np.array([1.0, np.nan]))
        assert company.value[0] == alone.value[0]


def test_damped_steps_solve_the_equations():
    rng = np.random.default_rng(0)
    j, r = rng.normal(size=(4, 5, 20)) * [[1e-6], [1], [1e3], [1], [1]], rng.normal(size=(4, 20))
    normal, damping = Normal.of(r, j), np.array([0.0, 1e-3, 1.0, 100.0])
    assert normal.cost == pytest.approx(0.5 * (r**2).sum(1))
    steps, predicted = damped_steps(normal.matrix, normal.gradient, damping)
    for k in range(4):
        weighted = np.sqrt(damping[k] * np.diag(normal.matrix[k]))
        rows, right = np.r_[j[k].T, np.diag(weighted)], np.r_[-r[k], np.zeros(5)]
        np.testing.assert_allclose(steps[k], np.linalg.lstsq(rows, right, rcond=None)[0], rtol=1e-9)
        left = 0.5 * ((r[k] + j[k].T @ steps[k]) ** 2).sum()
        assert predicted[k] == pytest.approx(normal.cost[k] - left, rel=1e-9)


def test_what_moves_nothing_stays_and_what_is_singular_is_solved():
    matrix = np.array([[[4.0, 0.0], [0.0, 0.0]], [[1.0, 1.0], [1.0, 1.0]], [[np.nan, 0], [0, 1]]])
    gradient = np.array([[2.0, 0.0], [1.0, 1.0], [1.0, 1.0]])
    steps, predicted = damped_steps(matrix, gradient, np.zeros(3))
    np.testing.assert_allclose(steps[0], [-0.5, 0.0])
    assert steps[1].sum() == pytest.approx(-1.0) and predicted[:2] == pytest.approx([0.5, 0.5])
    assert np.isnan(predicted[2])


class Pair(NamedTuple):
    a: np.ndarray
    b: np.ndarray


def test_batches():
    old, new = Pair(np.arange(3.0), np.zeros((3, 2))), Pair(np.arange(3.0) + 10, np.ones((3, 2)))
    every, some, none = np.ones(3, bool), np.array([True, False, True]), np.zeros(3, bool)
    assert rows_of(old, every) is old
    np.testing.assert_array_equal(rows_of(old, some).a, [0, 2])
    assert merged(none, new, old) is old
    both = merged(some, new, old)
    np.testing.assert_array_equal(both.a, [10, 1, 12])
    np.testing.assert_array_equal(both.b, [[1, 1], [0, 0], [1, 1]])
    whole = copied(old)
    put(whole, np.array([1]), rows_of(new, np.array([False, True, False])))
    np.testing.assert_array_equal(whole.a, [0, 11, 2])
    np.testing.assert_array_equal(old.a, [0, 1, 2])


# ------------------------------------------------------------------------------------ derivatives by differences
def test_derivatives_by_differences_lead_to_the_minimum():
    def residuals(x):
        return np.array([x[0] - 1, (x[1] - 2) * 1e-3, x[0] * x[1] - 2])

    found = minimise(Differences(residuals, 1e-6), np.array([[5.0, 9.0]]), Options(1e-12))
    assert found.state[0] == pytest.approx([1, 2], abs=1e-5) and found.stats.converged.all()


def test_a_step_out_of_the_domain_is_rejected():
    """From 30 the full Gauss-Newton step of log x - 1 leads to -42, where there is no logarithm."""
    found = minimise(Differences(lambda x: np.log(x) - 1, 1e-6), np.array([[30.0]]), Options(1e-12))
    assert found.state[0, 0] == pytest.approx(np.e, rel=1e-6) and found.stats.invalid[0] > 0


def test_a_start_out_of_the_domain_stays_where_it_is():
    found = minimise(Differences(np.log, 1e-6), np.array([[-1.0]]), Options())
    assert found.state[0, 0] == -1 and not found.stats.converged[0]


def test_an_inverse_bounded_where_rounding_decides():
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(4, 4)))[0]
    well = turn @ np.diag([1.0, 2.0, 3.0, 1e-6]) @ turn.T
    assert np.allclose(blocks.bounded_inverse(well) @ well, np.eye(4), atol=1e-8)
    pair = np.array(
        [[1.0, 1.0], [1.0, 1.0]]
    )  # the difference of the two is undetermined, or its curvature negative
    for share, bound in ((0.5, 1.0), (2.0, 0.5), (-1.0, 1.0)):  # eigenvalues 2 - lean and lean
        lean = share * 2 * blocks.RANK
        normal = np.diag([1e4, 1e-2]) @ (pair - lean * np.array([[0, 1], [1, 0]])) @ np.diag([1e4, 1e-2])
        variance = blocks.bounded_inverse(normal)[1, 1] * 1e-4
        # the rounding of 1 - lean is a hundredth of it
        assert variance == pytest.approx(bound / (2 * 2 * blocks.RANK), rel=0.05)
    without = blocks.bounded_inverse(np.diag([4.0, 0.0]))
    assert without[0, 0] == pytest.approx(0.25) and 1e100 < without[1, 1] < np.inf
