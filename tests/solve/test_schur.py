"""Steps by the Schur complement against dense linear algebra."""

from dataclasses import replace

import numpy as np
import pytest

from camcal.solve import rows, tangent
from camcal.solve.schur import Reduced, back_substitution, eliminate, solve_scaled
from tests.solve.problems import problem_of


@pytest.fixture(scope="module")
def case():
    problem, state = problem_of(ragged=True, fix={"aspect": None})
    return problem.linearise(state), rows.jacobian(problem, state), rows.residuals(problem, state)


def spd(count, size, seed=0):
    a = np.random.default_rng(seed).normal(size=(count, size + 3, size))
    return a.transpose(0, 2, 1) @ a


def bordered(blocks, right):
    """Blocks (V, n, n) with right sides (V, n, K), the blocks along the last axis."""
    return np.concatenate([blocks, right], 2).transpose(1, 2, 0).copy()


def test_elimination_of_many_matrices():
    blocks, right = spd(7, 6), np.random.default_rng(1).normal(size=(7, 6, 2))
    both = bordered(blocks, right)
    assert eliminate(both)
    expected = np.linalg.cholesky(blocks)
    above = np.triu_indices(6)
    np.testing.assert_allclose(both[:, :6][above], expected.transpose(2, 1, 0)[above], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(
        both[:, 6:], np.linalg.solve(expected, right).transpose(1, 2, 0), rtol=1e-9, atol=1e-12
    )


@pytest.mark.parametrize("bad", [-1.0, 0.0, np.nan])
@pytest.mark.parametrize("at", range(4))
def test_elimination_notices_a_pivot_that_is_not_positive(bad, at):
    blocks = spd(3, 4)
    blocks[1, at, :] = blocks[1, :, at] = 0.0
    blocks[1, at, at] = bad
    assert not eliminate(bordered(blocks, np.ones((3, 4, 1))))


def test_substitutions_solve():
    blocks, right = spd(5, 6), np.random.default_rng(1).normal(size=(5, 6, 1))
    both = bordered(blocks, right)
    assert eliminate(both)
    found = back_substitution(both, both[:, 6])
    expected = np.linalg.solve(blocks, right)[..., 0].T
    np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.parametrize("damping", [0.0, 1e-6, 1e-2, 10.0])
@pytest.mark.parametrize("scaled", [True, False])
def test_step_and_prediction_against_dense(case, damping, scaled):
    blocks, j, r = case
    squares = (j**2).sum(0)
    weights = squares if scaled else np.full(len(squares), squares.max())
    stacked = np.vstack([j, np.diag(np.sqrt(damping * weights))])
    unit = 1 / np.sqrt((stacked**2).sum(0))
    right = np.r_[-r, np.zeros(len(weights))]
    expected = unit * np.linalg.lstsq(stacked * unit, right, rcond=None)[0]
    step, predicted = Reduced(blocks, damping, scaled).step()
    # normal equations square the condition number, 500 here with scaled columns
    np.testing.assert_allclose(tangent.flat(step) / unit, expected / unit, rtol=0, atol=1e-8 * 300)
    model = 0.5 * ((r + j @ expected) ** 2).sum()
    assert predicted == pytest.approx(0.5 * r @ r - model, rel=1e-7)


def test_the_matrix_is_the_schur_complement(case):
    blocks, j, _ = case
    free = len(blocks.gradient)
    h = j.T @ j
    expected = h[:free, :free] - h[:free, free:] @ np.linalg.solve(h[free:, free:], h[free:, :free])
    found = Reduced(blocks).matrix
    size = np.sqrt(np.diag(h)[:free])
    np.testing.assert_allclose(found / size / size[:, None], expected / size / size[:, None], atol=1e-11)


def test_the_gradient_is_that_of_the_reduced_cost(case):
    blocks, j, r = case
    free = len(blocks.gradient)
    poses = j[:, free:]
    left = r - poses @ np.linalg.lstsq(poses, r, rcond=None)[0]
    size = np.sqrt((j[:, :free] ** 2).sum(0))
    np.testing.assert_allclose(Reduced(blocks).gradient / size, j[:, :free].T @ left / size, atol=1e-9)


def test_weakest_pivot_tells_of_digits(case):
    blocks, j, _ = case
    reduced = Reduced(blocks)
    reduced.step()
    unit = j / np.sqrt((j**2).sum(0))
    singular = np.linalg.svd(unit, compute_uv=False)
    squared = (singular[-1] / singular[0]) ** 2
    # a pivot is no less than the smallest eigenvalue; not more than some hundred times it in practice
    assert squared < reduced.weakest < 1000 * squared


def test_curvature_is_added(case):
    blocks, *_ = case
    plain, _ = Reduced(blocks).step()
    more = 3.0 * np.diag(np.diag(blocks.intrinsics))
    shorter, predicted = Reduced(blocks).step(more)
    size = np.sqrt(np.diag(blocks.intrinsics))
    assert np.linalg.norm(shorter.intrinsics * size) < np.linalg.norm(plain.intrinsics * size)
    assert predicted > 0


def test_unsolvable_equations_give_none(case):
    blocks, *_ = case
    poses = blocks.poses.copy()
    poses[0, 3, 3] = -1.0
    broken = Reduced(replace(blocks, poses=poses))
    assert not broken.solvable and broken.step() is None
    assert Reduced(replace(blocks, intrinsics=-blocks.intrinsics)).step() is None


def test_a_column_of_zeros_stays(case):
    # p3 multiplies p1 and p2, which are 0 at the start
    problem, state = problem_of("brown:radial=3,decentering=2")
    params = state.params.copy()
    params[[problem.lens.index(n) for n in ("p1", "p2", "p3")]] = 0.0
    blocks = problem.linearise(replace(state, params=params))
    step, predicted = Reduced(blocks).step()
    assert step.intrinsics[problem.lens.index("p3")] == 0.0
    assert np.isfinite(step.intrinsics).all() and predicted > 0


def test_solve_scaled_does_not_care_about_units():
    a = spd(1, 5)[0]
    right = np.arange(1.0, 6.0)
    units = 10.0 ** np.array([-9, 9, 0, 4, -6])
    found, _ = solve_scaled(a * units * units[:, None], right * units)
    np.testing.assert_allclose(found * units, np.linalg.solve(a, right), rtol=1e-10)


def test_no_camera_parameters():
    problem, state = problem_of(fix=dict.fromkeys(["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"]))
    step, predicted = Reduced(problem.linearise(state)).step()
    assert step.intrinsics.shape == (0,) and predicted > 0


def nearly_singular():
    """A matrix (4, 4) of rank 3 but for its rounding: Cholesky's factorisation finds pivots, Gauss's elimination 0."""
    rows = np.array([[-2.0, 2.0, 1.0], [-1.0, -3.0, 1.0], [-1.0, 3.0, -1.0], [1.0, -2.0, 0.0]])
    matrix = rows @ rows.T
    scale = 1 / np.sqrt(np.diag(matrix))
    return matrix * scale * scale[:, None]


def test_a_matrix_that_is_singular_but_for_rounding_gives_no_step(monkeypatch):
    found = solve_scaled(nearly_singular(), np.ones(4), scaled=False)
    assert found is None or np.isfinite(found[0]).all()  # as the linear algebra rounds, but no error

    def singular(*_):
        raise np.linalg.LinAlgError

    monkeypatch.setattr(np.linalg, "solve", singular)  # after a factorisation that succeeds
    assert solve_scaled(np.eye(4), np.ones(4)) is None
