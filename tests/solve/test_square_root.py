"""Steps by orthogonal factors, and when they are taken."""

from dataclasses import replace

import numpy as np
import pytest

from camcal.solve import rows, tangent
from camcal.solve.condition import condition
from camcal.solve.linear import Linear
from camcal.solve.problem import Problem
from camcal.solve.schur import Reduced
from camcal.solve.square_root import SquareRoot, triangles
from tests.solve.problems import problem_of

KINDS = {
    "plain": {},
    "ragged": {"ragged": True, "sigma": True},
    "bowl": {"board": "bowl"},
    "kb4": {"model": "kb4"},
}


@pytest.fixture(params=KINDS, ids=list(KINDS))
def case(request):
    return problem_of(**KINDS[request.param])


@pytest.mark.parametrize("damping", [0.0, 1e-3])
@pytest.mark.parametrize("scaled", [True, False])
def test_same_step_as_by_normal_equations(case, damping, scaled):
    problem, state = case
    blocks = problem.linearise(state)
    ours, predicted = SquareRoot.of(problem, state).step(blocks, damping, scaled)
    other, expected = Reduced(blocks, damping, scaled).step()
    size = np.sqrt(tangent.diagonal(blocks))
    # the normal equations' error: rounding times the squared condition number, 1e-16 x 1e6
    np.testing.assert_allclose(tangent.flat(ours) * size, tangent.flat(other) * size, atol=1e-6)
    assert predicted == pytest.approx(expected, rel=1e-7)


def test_the_reduced_triangle_is_the_root_of_the_schur_complement(case):
    problem, state = case
    root = SquareRoot.of(problem, state).reduced()
    s = Reduced(problem.linearise(state)).matrix
    size = np.sqrt(np.diag(s))
    np.testing.assert_allclose(root.T @ root / size / size[:, None], s / size / size[:, None], atol=1e-9)


def weak(power):
    """A view so far away that its perspective nearly vanishes: rotation and depth are hardly determined."""
    problem, state = problem_of(count=4)
    far = 10.0**power
    params = state.params.copy()
    params[:2] *= far
    return problem, replace(state, params=params, centres=state.centres * [1, 1, far])


def test_keeps_digits_where_normal_equations_lose_them():
    problem, state = weak(4)
    blocks = problem.linearise(state)
    j, r = rows.jacobian(problem, state), rows.residuals(problem, state)
    unit = 1 / np.sqrt((j**2).sum(0))
    # the same least squares problem in extended precision, from the same rows
    exact = unit * _extended(j * unit, -r)
    steps = {"qr": SquareRoot.of(problem, state).step(blocks, 0.0), "schur": Reduced(blocks).step()}
    size = np.linalg.norm(exact / unit)
    error = {
        name: np.inf if s is None else np.linalg.norm((tangent.flat(s[0]) - exact) / unit) / size
        for name, s in steps.items()
    }
    # 4 digits better at this condition number, measured 1e-9 against 1e-3 or no step at all
    assert error["qr"] < 1e-4 * error["schur"]


def _extended(a, b):
    """Least squares by Gram-Schmidt, done twice, in long double."""
    a, b = a.astype(np.longdouble), b.astype(np.longdouble)
    q, r = np.zeros_like(a), np.zeros((a.shape[1], a.shape[1]), np.longdouble)
    for k in range(a.shape[1]):
        v = a[:, k].copy()
        for _ in range(2):
            along = q[:, :k].T @ v
            v -= q[:, :k] @ along
            r[:k, k] += along
        r[k, k] = np.sqrt(v @ v)
        q[:, k] = v / r[k, k]
    y = q.T @ b
    x = np.zeros_like(y)
    for k in reversed(range(len(x))):
        x[k] = (y[k] - r[k, k + 1 :] @ x[k + 1 :]) / r[k, k]
    return x.astype(float)


def test_auto_takes_it_where_it_is_needed_only():
    for power, needed in ((0, False), (5, True)):
        problem, state = weak(power)
        linear = Linear(problem)
        linear.step(state, problem.linearise(state), 0.0)
        assert (linear.solved > 0) == needed
        assert ("solved_by_qr" in linear.info()) == needed


def test_singular_equations_give_none():
    problem, state = problem_of(count=2)
    same = Problem(problem.lens, [problem.views[0].take(slice(0, 2))] * 2, problem.free)
    one = same.state(state.params, problem.poses(state))
    assert SquareRoot.of(same, one).step(same.linearise(one), 0.0) is None


def test_a_column_of_zeros_stays():
    problem, state = problem_of("brown:radial=2,decentering=2")
    params = state.params.copy()
    params[[problem.lens.index(n) for n in ("p1", "p2", "p3")]] = 0.0
    state = replace(state, params=params)
    blocks = problem.linearise(state)
    for damping in (0.0, 1e-3):
        ours, _ = SquareRoot.of(problem, state).step(blocks, damping)
        other, _ = Reduced(blocks, damping).step()
        assert ours.intrinsics[problem.lens.index("p3")] == 0.0
        np.testing.assert_allclose(ours.intrinsics, other.intrinsics, rtol=1e-6, atol=1e-9)


def test_triangles_of_short_matrices():
    a = np.random.default_rng(0).normal(size=(3, 2, 4))
    r = triangles(a)
    assert r.shape == (3, 4, 4)
    np.testing.assert_allclose(r.transpose(0, 2, 1) @ r, a.transpose(0, 2, 1) @ a, atol=1e-12)


@pytest.mark.parametrize("scaled", [True, False])
def test_condition_number_against_the_singular_values(case, scaled):
    problem, state = case
    j = rows.jacobian(problem, state)
    if scaled:
        j = j / np.sqrt((j**2).sum(0))
    singular = np.linalg.svd(j, compute_uv=False)
    # Lanczos is stopped at 1e-3 of the squares
    assert condition(SquareRoot.of(problem, state), scaled) == pytest.approx(
        singular[0] / singular[-1], rel=5e-3
    )


def test_condition_number_of_a_singular_problem():
    problem, state = problem_of("brown:radial=2,decentering=2")
    params = state.params.copy()
    params[[problem.lens.index(n) for n in ("p1", "p2", "p3")]] = 0.0
    assert condition(SquareRoot.of(problem, replace(state, params=params))) == np.inf
