"""Eliminating the board's points first leads to the step that eliminating the poses first leads to."""

import numpy as np
import pytest

from camcal.solve.board import make_board
from camcal.solve.linear import Linear
from camcal.solve.points_first import PointsFirst
from camcal.solve.schur import Reduced
from tests.solve.problems import problem_of


@pytest.fixture(scope="module")
def free():
    return problem_of(count=6, board="free")


@pytest.mark.parametrize("damping", [1e-8, 1e-4, 1.0])
def test_the_same_step(free, damping):
    problem, state = free
    blocks = problem.linearise(state)
    step, predicted = PointsFirst(blocks, damping, problem.point_coordinates).step()
    expected, decrease = Reduced(blocks, damping).step()
    # both are Cholesky forms of one matrix: its condition number, 1e5 with scaled columns, costs as many digits
    scale = 1 / np.sqrt(np.diag(blocks.intrinsics))
    assert np.abs((step.intrinsics - expected.intrinsics) / scale).max() < 1e-6
    np.testing.assert_allclose(step.poses, expected.poses, atol=1e-6 * np.abs(expected.poses).max())
    assert predicted == pytest.approx(decrease, rel=1e-9)


def test_the_smaller_system_is_chosen(free):
    problem, state = free
    blocks = problem.linearise(state)
    linear = Linear(problem)
    assert isinstance(
        linear._reduced(blocks, 0.0, None), PointsFirst
    )  # 155 coordinates against 36 of the poses
    bowl, start = problem_of(count=6, board="bowl")
    assert isinstance(Linear(bowl)._reduced(bowl.linearise(start), 0.0, None), Reduced)


def test_a_block_that_is_not_positive_definite_gives_no_step(free):
    problem, state = free
    blocks = problem.linearise(state)
    blocks.intrinsics[-1, -1] = -1.0
    assert PointsFirst(blocks, 0.0, problem.point_coordinates).step() is None


def test_blocks_of_points_fold_as_the_whole_matrix(free):
    problem, _ = free
    rng = np.random.default_rng(0)
    for kind in ("free", "print"):
        board = make_board(problem.views, kind)
        m = len(board.points)
        blocks = rng.normal(size=(m, 3, 3))
        whole = np.zeros((m, 3, m, 3))
        whole[range(m), :, range(m), :] = blocks
        expected = board.fold(board.fold(whole.reshape(3 * m, 3 * m)).T).T
        np.testing.assert_allclose(board.fold_blocks(blocks), expected, atol=1e-12)
