"""The square-root steps against the textbook formulas they stand for."""

import numpy as np
import pytest

from camcal.track import linear

RNG = np.random.default_rng(0)


@pytest.mark.parametrize("m", [3, 11, 12, 100])
def test_compress_keeps_all_that_the_equations_say(m):
    jacobian, r = RNG.normal(size=(m, 11)), RNG.normal(size=m)
    found = linear.compress(np.vstack([jacobian.T, r]))
    np.testing.assert_allclose(found.a.T @ found.a, jacobian.T @ jacobian, atol=1e-12 * m)
    np.testing.assert_allclose(found.a.T @ found.z, jacobian.T @ r, atol=1e-12 * m)
    assert found.rest + found.z @ found.z == pytest.approx(r @ r, rel=1e-12)
    assert found.dof == max(m - 11, 0)
    if m < 11:
        assert found.rest == pytest.approx(0, abs=1e-12)


def test_triangle_is_a_square_root():
    rows = RNG.normal(size=(5, 9))
    factor = linear.triangle(rows.copy())
    np.testing.assert_allclose(factor @ factor.T, rows @ rows.T, atol=1e-12)
    assert not np.triu(factor, 1).any()


@pytest.mark.parametrize("best", [True, False])
def test_joseph_is_the_covariance_of_any_gain(best):
    a, factor = np.triu(RNG.normal(size=(3, 3))), np.tril(RNG.normal(size=(6, 6)))
    p = factor @ factor.T
    h = np.hstack([a, np.zeros((3, 3))])
    gain = p @ h.T @ np.linalg.inv(h @ p @ h.T + np.eye(3)) if best else RNG.normal(size=(6, 3))
    keep = np.eye(6) - gain @ h
    found = linear.joseph(gain, a, factor)
    np.testing.assert_allclose(found @ found.T, keep @ p @ keep.T + gain @ gain.T, atol=1e-11)
    if best:
        np.testing.assert_allclose(found @ found.T, keep @ p, atol=1e-11)


def test_singular_systems_are_refused():
    with pytest.raises(np.linalg.LinAlgError, match="singular triangular matrix"):
        linear.solve_upper(np.diag([1.0, 0.0]), np.ones(2))
    with pytest.raises(np.linalg.LinAlgError, match="not positive definite"):
        linear.cholesky(-np.eye(2))
