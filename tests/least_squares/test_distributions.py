"""Distributions of test statistics, against scipy.stats."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from camcal.least_squares import distributions as ours

FREEDOM = st.integers(1, 5000)
#: of a double: these are the tails that corrected tests look at
PROBABILITY = st.floats(1e-12, 1 - 1e-9)


@given(PROBABILITY, FREEDOM, FREEDOM)
def test_f(p, m, n):
    bound = ours.f_bound(p, m, n)
    assert ours.f_exceeded(bound, m, n) == pytest.approx(p, rel=1e-6)
    assert ours.f_exceeded(bound, m, n) == pytest.approx(stats.f.sf(bound, m, n), rel=1e-9)


@given(PROBABILITY, FREEDOM)
def test_chi2(p, n):
    assert ours.chi2_quantile(p, n) == pytest.approx(stats.chi2.ppf(p, n), rel=1e-9)


@given(st.floats(-8, 8))
def test_normal(x):
    assert ours.normal_exceeded(x) == pytest.approx(stats.norm.sf(x), rel=1e-12)


@pytest.mark.parametrize("draw", ["normal", "laplace", "uniform", "exponential"])
@pytest.mark.parametrize("count", [20, 200, 5000])
def test_normality(draw, count):
    x = getattr(np.random.default_rng(count), draw)(size=count)
    statistic, p = ours.normality(x)
    expected = stats.normaltest(x)
    assert statistic == pytest.approx(expected.statistic, rel=1e-9)
    assert p == pytest.approx(expected.pvalue, rel=1e-6)
    assert ours.excess_kurtosis(x) == pytest.approx(stats.kurtosis(x), rel=1e-9, abs=1e-12)


#: below it scipy forms n / (n + t²) and keeps no more than t = 1e-8; above it that costs 1e-16 / t of the tail
SMALL = 1e-4


@given(st.floats(-50, 50), st.integers(1, 5000))
def test_t(t, n):
    if abs(t) > SMALL:
        expected = stats.t.sf(t, n)
    else:  # the first two terms of the series of the integral over the density; the third is t⁵
        expected = 0.5 - stats.t.pdf(0, n) * (t - (n + 1) / n * t**3 / 6)
    assert ours.t_exceeded(t, n) == pytest.approx(expected, rel=1e-9)


@given(st.floats(1e-12, 0.49), st.floats(1, 1e5))
def test_the_bound_of_t(p, n):
    bound = ours.t_bound(p, n)
    assert bound > 0 and ours.t_exceeded(bound, n) == pytest.approx(p, rel=1e-9)


@pytest.mark.parametrize("n", [1, 4, 5000])
def test_the_ends_of_t(n):
    assert ours.t_exceeded(-np.inf, n) == 1 and ours.t_exceeded(np.inf, n) == 0
    assert ours.t_exceeded(1e-300, n) == ours.t_exceeded(-1e-300, n) == ours.t_exceeded(0.0, n) == 0.5
    assert np.isnan(ours.t_exceeded(float("nan"), n))


@pytest.mark.parametrize("x", [1e-9, 1e-3, 0.5, 1 - 1e-9])
def test_the_other_end_of_the_beta_function(x):
    assert ours.beta_part(2.5, 0.5, x, 1 - x) == ours.beta_part(2.5, 0.5, x)
    assert ours.beta_part(0.5, 2.5, 1 - x, x) + ours.beta_part(2.5, 0.5, x, 1 - x) == pytest.approx(
        1, rel=1e-12
    )


@pytest.mark.parametrize("freedom", [20_000, 1_000_000])
def test_f_of_large_sets(freedom):
    for x in (0.5, 1.0, 1.2, 3.0):
        assert ours.f_exceeded(x, 150, freedom) == pytest.approx(stats.f.sf(x, 150, freedom), rel=1e-8)


def test_what_is_no_probability():
    assert np.isnan(ours.f_exceeded(1.0, 0, 5)) and np.isnan(ours.f_exceeded(float("nan"), 2, 5))
    assert ours.f_exceeded(0.0, 2, 5) == 1.0 and ours.f_exceeded(float("inf"), 2, 5) == 0.0
