"""Inverses of curves and of maps of the plane, on their quick way and on the slow one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camcal.model.lenses import newton
from camcal.model.lenses.curve import Inverse, first_root, memo


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


def test_what_is_remembered_belongs_to_its_parameters():
    class Owner:
        pass

    owner, k, calls = Owner(), np.array([1.0, 2.0]), []

    def compute(kept):
        calls.append(kept)
        return lambda: kept.sum()

    first = memo(owner, k, compute)
    assert memo(owner, k, compute) is first and len(calls) == 1
    k[0] = 5.0  # what the first call kept does not move with it
    assert first() == 3.0 and memo(owner, k, compute)() == 7.0


def bent(a, b):
    """x = a (1 - 0.2 s) + a shear: folds at s = 5 / 3."""
    s = a * a + b * b
    f = 1 - 0.2 * s
    return a * f + 0.01 * b, b * f, f - 0.4 * a * a, 0.01 - 0.4 * a * b, -0.4 * a * b, f - 0.4 * b * b


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
