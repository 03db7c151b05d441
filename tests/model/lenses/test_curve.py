"""Inverses of curves and of maps of the plane, on their quick way and on the slow one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camcal.model.lenses import newton
from camcal.model.lenses.curve import Inverse, bernstein, cached, first_root


def cubic(c):
    return lambda t: (t + c * t**3, 1 + 3 * c * t**2)


@given(st.floats(-0.3, 0.5), st.lists(st.floats(0, 1), min_size=1, max_size=20))
def test_the_inverse_leads_back(c, parts):
    top = first_root([1.0, 0.0, 3 * c], 3.0)
    inverse = Inverse(cubic(c), top)
    target = np.array(parts) * inverse.end
    t, solved = inverse(target)
    assert solved.all() and ((t >= 0) & (t <= top)).all()
    # SOLVED, of f; at the fold itself t is known to the root of the rounding only
    np.testing.assert_allclose(cubic(c)(t)[0], target, rtol=1e-12, atol=1e-12)


def test_a_steep_curve_up_to_its_pole():
    inverse = Inverse(lambda t: (np.tan(t), 1 + np.tan(t) ** 2), np.pi / 2 - 1e-9)
    t, solved = inverse(np.array([0.0, 1e-9, 1.0, 1e3, 1e8]))
    assert solved.all()
    np.testing.assert_allclose(t, np.arctan([0.0, 1e-9, 1.0, 1e3, 1e8]), rtol=0, atol=1e-11)


def test_beyond_the_end_there_is_no_inverse():
    inverse = Inverse(cubic(-0.1), first_root([1.0, 0.0, -0.3]))
    t, solved = inverse(np.array([-0.1, 0.5, inverse.end * 1.001, np.inf, np.nan]))
    assert solved.tolist() == [False, True, False, False, False] and np.isfinite(t).all()
    assert inverse(np.zeros(0))[0].shape == (0,)


def test_the_table_alone_is_good_to_nine_digits():
    inverse = Inverse(cubic(0.2), 2.0)
    t = np.linspace(0.01, 1.9, 500)
    np.testing.assert_allclose(inverse.start(cubic(0.2)(t)[0]), t, rtol=1e-8)


@given(st.lists(st.floats(-2, 2), min_size=1, max_size=8), st.floats(0.01, 3))
def test_bernstein_coefficients_bound_a_polynomial(ascending, top):
    values = np.polynomial.polynomial.polyval(np.linspace(0, top, 50), ascending)
    found = np.array(bernstein(ascending, top))
    rounding = 1e-12 * max(top, 1) ** len(ascending)
    assert (values >= found.min() - rounding).all() and (values <= found.max() + rounding).all()
    np.testing.assert_allclose(found[[0, -1]], values[[0, -1]], rtol=0, atol=rounding)


def test_a_value_that_a_curve_jumps_over_has_no_inverse():
    def jumps(t):
        return t + 1e-6 * (t > 0.5), np.ones_like(t)

    t, solved = Inverse(jumps, 1.0)(np.array([0.3, 0.5 + 5e-7, 0.8]))
    assert solved.tolist() == [True, False, True]
    np.testing.assert_allclose(t[[0, 2]], [0.3, 0.8 - 1e-6], rtol=0, atol=1e-12)


class Owner:
    """Something with a value; `calls` counts how often it computes."""

    calls = 0

    def __init__(self, value):
        self.value = value

    def __eq__(self, other):
        return self.value == other.value

    def __hash__(self):
        return hash(self.value)

    @cached
    def compute(self, k):
        Owner.calls += 1
        return lambda: self.value + k.sum()


def test_what_is_kept_belongs_to_the_owners_value_and_the_coefficients():
    owner, k = Owner(10), np.array([1.0, 2.0])
    first = owner.compute(k)
    assert owner.compute(k) is first and Owner(10).compute(k.copy()) is first and Owner.calls == 1
    assert Owner(20).compute(k)() == 23.0 and Owner.calls == 2
    k[0] = 5.0  # what was computed for the first coefficients does not move with them
    assert first() == 13.0 and owner.compute(k)() == 17.0
    assert vars(owner) == {"value": 10}


def bent(a, b):
    """x = a (1 - 0.2 s) + a shear: folds at s = 5 / 3."""
    s = a * a + b * b
    f = 1 - 0.2 * s
    return a * f + 0.01 * b, b * f, f - 0.4 * a * a, 0.01 - 0.4 * a * b, -0.4 * a * b, f - 0.4 * b * b


def test_next_to_the_fold_of_a_map():
    """Along b = 0 it folds at a² = 5 / 3, x = 2 a / 3: a point beyond, by a thousandth of a px, has no solution."""
    peak = np.sqrt(5 / 3) * 2 / 3
    x = np.array([peak - 1e-6, peak + 1e-6])
    with np.errstate(all="ignore"):
        a, b, solved = newton.solve(bent, x, np.zeros(2), x.copy(), np.zeros(2))
    assert solved.tolist() == [True, False]
    assert abs(bent(a, b)[0][0] - x[0]) < 1e-11


@pytest.mark.parametrize("start", ["near", "far"])
def test_newton_in_the_plane(start):
    rng = np.random.default_rng(0)
    a, b = rng.uniform(-0.8, 0.8, (2, 200))
    x, y = bent(a, b)[:2]
    first = (x.copy(), y.copy()) if start == "near" else (0.3 * x, 0.3 * y)
    found = newton.solve(bent, x, y, *first)
    assert found[2].all()
    np.testing.assert_allclose(found[0], a, rtol=0, atol=1e-13)
    np.testing.assert_allclose(found[1], b, rtol=0, atol=1e-13)


def test_points_without_a_solution_do_not_disturb_the_others():
    x, y = np.array([0.1, 5.0, np.nan, 0.4]), np.array([0.2, 5.0, 0.0, -0.3])
    with np.errstate(all="ignore"):
        a, b, solved = newton.solve(bent, x, y, x.copy(), y.copy())
    assert solved.tolist() == [True, False, False, True]
    np.testing.assert_allclose(bent(a, b)[0][[0, 3]], x[[0, 3]], rtol=0, atol=1e-14)


def test_the_radial_start_is_exact_without_decentering():
    start = newton.RadialStart(lambda s: (1 - 0.2 * s, np.full_like(s, -0.2)), np.sqrt(5 / 3))
    a, b = np.array([0.0, 0.3, -0.6, 1e-180]), np.array([0.0, -0.2, 0.5, 0.0])
    f = 1 - 0.2 * (a * a + b * b)
    for got, want in zip(start(a * f, b * f), (a, b), strict=True):
        np.testing.assert_allclose(got, want, rtol=1e-8, atol=1e-150)


@pytest.mark.parametrize("far", [1e-81, 1e-30, 1e-12, 0.0])
def test_a_coefficient_next_to_zero_makes_up_no_root(far):
    grows = [1.0, 1.5, 2.5, far, far / 2, 3 * far]
    assert first_root(grows) == np.inf and first_root([*grows, -far]) > 10
    assert first_root([1.0, -4.0, far, far]) == pytest.approx(0.25, rel=1e-11)


@given(
    st.floats(-6, 6),
    st.lists(st.floats(0.0, 6).map(lambda e: -(10**e)), max_size=3),
    st.lists(st.tuples(st.floats(0, 3), st.floats(0.5, 3)), max_size=2),
)
def test_the_first_root_of_a_polynomial_made_of_its_roots(exponent, negative, pairs):
    """Against roots that were multiplied out: one positive one, negative ones and complex pairs further out."""
    first = 10**exponent
    polynomial = np.polynomial.Polynomial([1, -1 / first])
    for root in negative:
        polynomial *= np.polynomial.Polynomial([1, -1 / (first * root)])
    for size, angle in pairs:
        far = first * 10**size
        polynomial *= np.polynomial.Polynomial([1, -2 * np.cos(angle) / far, 1 / far**2])
    # its condition: two pairs .5 rad beside the root make it up to some 1e4
    assert first_root(polynomial.coef) == pytest.approx(first, rel=1e-10)


def test_a_double_root_counts_and_a_close_pair_does_not():
    assert first_root([1.0, -2.0, 1.0]) == pytest.approx(1.0, rel=1e-7)
    apart = 1e-3
    assert first_root([1.0, -2.0, 1.0 + apart**2]) == np.inf
    assert (
        first_root([0.0, 1.0, -2.0]) == 0.5
        and first_root([1.0, np.nan]) == 0.0
        and first_root([0.0]) == np.inf
    )
