"""Properties of rotations. What these do not prove: derivatives, which the refinement's tests check."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camcal.geometry import rotations

finite = st.floats(-1, 1)
unit = (
    st.tuples(finite, finite, finite)
    .filter(lambda v: np.linalg.norm(v) > 1e-3)
    .map(lambda v: np.array(v) / np.linalg.norm(v))
)
# near 0 and near pi included, where formulas lose digits
angle = st.one_of(st.floats(0, np.pi), st.floats(0, 1e-6), st.floats(1e-12, 1e-6).map(lambda d: np.pi - d))
euler_beta = st.one_of(
    st.floats(-np.pi / 2, np.pi / 2),
    st.floats(0, 1e-6).map(lambda d: np.pi / 2 - d),
    st.floats(0, 1e-6).map(lambda d: d - np.pi / 2),
)
turn = st.floats(-np.pi, np.pi)

EPS = 1e-14  # a few dozen roundings of numbers of size 1


@given(unit, angle)
def test_exp_is_a_rotation(axis, a):
    r = rotations.exp(axis * a)
    np.testing.assert_allclose(r @ r.T, np.eye(3), atol=EPS)
    assert np.linalg.det(r) == pytest.approx(1, abs=EPS)
    np.testing.assert_allclose(r @ axis, axis, atol=EPS)


@given(unit, angle)
def test_log_undoes_exp(axis, a):
    # an error of 1e-16 in a matrix near the half turn moves the vector by about the same; within rounding of the
    # half turn itself, both senses of rotation are the same matrix
    v = rotations.log(rotations.exp(axis * a))
    if np.pi - a < 1e-15 and v @ axis < 0:
        v = -v
    np.testing.assert_allclose(v, axis * a, atol=1e-13)


@given(unit)
def test_half_turn(axis):
    r = 2 * np.outer(axis, axis) - np.eye(3)
    v = rotations.log(r)
    assert np.linalg.norm(v) == pytest.approx(np.pi, abs=1e-12)
    np.testing.assert_allclose(rotations.exp(v), r, atol=1e-13)


@given(unit, st.floats(1e-300, 1e-9))
def test_tiny_rotations_keep_their_digits(axis, a):
    np.testing.assert_allclose(rotations.log(rotations.exp(axis * a)), axis * a, rtol=1e-7, atol=1e-16)


@given(unit, angle, unit, st.floats(-1e-5, 1e-5))
def test_perturbation_acts_on_the_left(axis, a, other, d):
    r = rotations.exp(axis * a)
    moved = rotations.exp(other * d) @ r
    # first order in d; the second-order term is d²/2
    np.testing.assert_allclose(moved, r + d * rotations.skew(other) @ r, atol=d * d + EPS)


@given(unit, angle)
def test_quaternions_round_trip(axis, a):
    r = rotations.exp(axis * a)
    np.testing.assert_allclose(rotations.from_quaternion(rotations.quaternion(r)), r, atol=EPS)
    np.testing.assert_allclose(rotations.from_quaternion(-3 * rotations.quaternion(r)), r, atol=EPS)


@given(unit, angle, unit, angle)
def test_angle_between(axis, a, other, b):
    r, s = rotations.exp(axis * a), rotations.exp(other * b)
    chord = np.linalg.norm(r - s)  # = 2 sqrt(2) sin(angle / 2)
    assert 2 * np.sqrt(2) * np.sin(rotations.angle_between(r, s) / 2) == pytest.approx(chord, abs=1e-13)


@given(turn, euler_beta, turn)
def test_euler_angles_give_the_rotation_back(alpha, beta, theta):
    r = rotations.from_euler(alpha, beta, theta)
    np.testing.assert_allclose(rotations.from_euler(*rotations.to_euler(r)), r, atol=EPS)


@given(turn, st.floats(-1.5, 1.5), turn)
def test_euler_angles_come_back(alpha, beta, theta):
    found = rotations.to_euler(rotations.from_euler(alpha, beta, theta))
    # 1.5 rad: cos beta = 0.07 divides the rounding; differences modulo a whole turn
    apart = (np.array(found) - [alpha, beta, theta] + np.pi) % (2 * np.pi) - np.pi
    np.testing.assert_allclose(apart, 0, atol=1e-13)


@pytest.mark.parametrize("beta", [np.pi / 2, -np.pi / 2])
@given(alpha=turn, theta=turn)
def test_gimbal_lock(beta, alpha, theta):
    r = np.round(rotations.from_euler(0, beta, 0)) @ rotations.from_euler(alpha, 0, 0)
    r = rotations.from_euler(0, 0, theta) @ r
    found = rotations.to_euler(r)
    assert found[1] == pytest.approx(beta, abs=1e-7)  # arccos-like: 1e-15 in the matrix is 1e-7.5 here
    np.testing.assert_allclose(rotations.from_euler(*found), r, atol=EPS)


def test_euler_order_is_that_of_the_paper():
    rx, ry, rz = (rotations.exp(np.array(v)) for v in ([0.1, 0, 0], [0, 0.2, 0], [0, 0, 0.3]))
    np.testing.assert_allclose(rotations.from_euler(0.1, 0.2, 0.3), rz @ ry @ rx, atol=EPS)


def test_batches_equal_single_ones():
    v = np.random.default_rng(0).normal(size=(4, 5, 3))
    r = rotations.exp(v)
    for i in np.ndindex(4, 5):
        np.testing.assert_array_equal(r[i], rotations.exp(v[i]))
        np.testing.assert_array_equal(rotations.log(r)[i], rotations.log(r[i]))
        np.testing.assert_allclose(rotations.nearest(r)[i], r[i], atol=EPS)


def test_nearest_and_fit():
    random = np.random.default_rng(1)
    r = rotations.exp(np.array([0.4, -0.2, 1.0]))
    # scaling by a positive definite factor on the right leaves the nearest rotation
    factor = random.normal(size=(3, 3))
    np.testing.assert_allclose(rotations.nearest(r @ (factor @ factor.T + np.eye(3))), r, atol=1e-13)
    b = random.normal(size=(10, 3))
    a = b @ r.T
    np.testing.assert_allclose(rotations.fit_rotation(a, b), r, atol=1e-13)
    a[0] += 5  # an outlier of weight 0 does not count
    weights = np.r_[0.0, np.ones(9)]
    np.testing.assert_allclose(rotations.fit_rotation(a, b, weights), r, atol=1e-13)


def test_left_jacobian_against_differences():
    rng = np.random.default_rng(5)
    for size in (0.0, 1e-9, 1e-3, 9e-3, 0.011, 0.5, 3.0, 5.0):
        v = rng.normal(size=3)
        v *= size / np.linalg.norm(v)
        j = rotations.left_jacobian(v)
        for i in range(3):
            step = np.zeros(3)
            step[i] = 1e-6
            both = [rotations.log(rotations.exp(v + s * step) @ rotations.exp(v).T) for s in (1, -1)]
            # central differences of 1e-6: rounding 1e-10
            np.testing.assert_allclose(j[:, i], (both[0] - both[1]) / 2e-6, atol=1e-8)


def test_left_jacobian_series_meets_the_formula():
    axis = np.array([0.6, -0.64, 0.48])
    below, above = (rotations.left_jacobian(axis * t) for t in (0.01 * (1 - 1e-9), 0.01 * (1 + 1e-9)))
    np.testing.assert_allclose(below, above, atol=1e-11)
