"""The least squares problem: cost, gradient, blocks, retraction, padding, weights, the board's shape."""

from dataclasses import replace

import numpy as np
import pytest

from camcal.solve import rows, tangent
from camcal.solve.problem import Problem, Step
from tests import solved
from tests.solve.problems import cost_of, problem_of, step_of

KINDS = {
    "opencv5": {},
    "skew": {"skew": True},
    "tied": {"fix": {"aspect": None, "cx": None}},
    "ragged": {"ragged": True},
    "weighted": {"sigma": True, "ragged": True},
    "opencv14": {"model": "opencv14"},
    "kb4": {"model": "kb4"},
    "brown": {"model": "brown:radial=4,decentering=2,prism=1,centre=free"},
    "far": {"offset": 30.0},
    "not normalised": {"normalise": False, "offset": 5.0},
    "bowl": {"board": "bowl"},
    "print": {"board": "print", "ragged": True},
    "free": {"board": "free", "sigma": True},
}


@pytest.fixture(params=KINDS, ids=list(KINDS))
def case(request):
    return problem_of(**KINDS[request.param])


def moved(problem, state, step, length):
    return problem.retract(state, Step(length * step.intrinsics, length * step.poses))


def test_cost_is_that_of_the_projections(case):
    problem, state = case
    # sums of 300 squares in another order
    assert problem.linearise(state).cost == pytest.approx(cost_of(problem, state), rel=1e-12)


def test_gradient_against_differences(case):
    problem, state = case
    rng = np.random.default_rng(1)
    gradient = tangent.gradient(problem.linearise(state))
    for _ in range(4):
        step = step_of(problem, rng)
        h = 1e-3
        costs = [problem.linearise(moved(problem, state, step, f * h)).cost for f in (-2, -1, 1, 2)]
        slope = (costs[0] - 8 * costs[1] + 8 * costs[2] - costs[3]) / (12 * h)
        # fourth-order differences: their own error is near 1e-9 of the terms that cancel in the slope
        size = np.linalg.norm(gradient) * np.linalg.norm(tangent.flat(step))
        assert gradient @ tangent.flat(step) == pytest.approx(slope, rel=1e-6, abs=1e-7 * size)


def test_blocks_are_those_of_the_rows(case):
    problem, state = case
    blocks = problem.linearise(state)
    j, r = rows.jacobian(problem, state), rows.residuals(problem, state)
    assert blocks.cost == pytest.approx(0.5 * r @ r, rel=1e-12)
    scale = tangent.inverse_lengths(tangent.diagonal(blocks))
    np.testing.assert_allclose(scale * tangent.gradient(blocks), scale * (j.T @ r), rtol=0, atol=1e-9)
    rng = np.random.default_rng(2)
    v = scale * rng.normal(size=len(scale))
    np.testing.assert_allclose(scale * tangent.multiply(blocks, v), scale * (j.T @ (j @ v)), atol=1e-10)
    np.testing.assert_allclose(tangent.diagonal(blocks), (j**2).sum(0), rtol=1e-11)
    sparse = rows.jacobian(problem, state, sparse=True)
    np.testing.assert_array_equal(sparse.toarray(), j)


def test_the_rows_are_derivatives_of_the_residuals(case):
    problem, state = case
    step = step_of(problem, np.random.default_rng(3))
    h = 1e-3
    both = [rows.residuals(problem, moved(problem, state, step, f * h)) for f in (-1, 1)]
    slopes = rows.jacobian(problem, state) @ tangent.flat(step)
    # central differences: curvature leaves h² of what a step of length 1 changes, some px
    np.testing.assert_allclose((both[1] - both[0]) / (2 * h), slopes, atol=1e-5 * abs(slopes).max())


def test_a_start_gives_its_poses_back():
    problem, state = problem_of(offset=30.0)
    poses = problem.poses(state)
    again = problem.state(state.params, poses)
    np.testing.assert_allclose(again.centres, state.centres, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(again.rotations, state.rotations)


def test_a_step_of_nothing_changes_nothing():
    problem, state = problem_of()
    same = problem.retract(state, Step(np.zeros(problem.variables), np.zeros((len(problem.views), 6))))
    for name in ("params", "rotations", "centres"):
        np.testing.assert_array_equal(getattr(same, name), getattr(state, name))


def test_ragged_views_cost_what_they_cost_alone():
    problem, state = problem_of(ragged=True, sigma=True)
    whole = problem.linearise(state)
    for i, view in enumerate(problem.views):
        one = Problem(problem.lens, [view], problem.free)
        poses = problem.poses(state)[i : i + 1]
        alone = one.linearise(one.state(state.params, poses))
        # the same sums, filled up with zeros
        assert whole.view_costs[i] == pytest.approx(alone.cost, rel=1e-12)
        np.testing.assert_allclose(whole.poses[i], alone.poses[0], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(whole.coupling[i], alone.coupling[0], rtol=1e-9, atol=1e-6)


def test_groups_of_views_hold_all_of_them_once():
    problem, _ = problem_of(count=150, ragged=False)
    members = np.concatenate([g.members for g in problem.groups])
    assert len(problem.groups) > 1
    assert sorted(members.tolist()) == list(range(150))


def test_sigmas_weight_and_given_weights_replace_them():
    problem, state = problem_of(sigma=True)
    ones = [np.ones(len(v)) for v in problem.views]
    plain = Problem(problem.lens, problem.views, problem.free, weights=ones)
    unweighted = Problem(problem.lens, [replace(v, sigma=None) for v in problem.views], problem.free)
    assert plain.linearise(state).cost == pytest.approx(unweighted.linearise(state).cost, rel=1e-12)
    assert problem.linearise(state).cost != pytest.approx(plain.linearise(state).cost, rel=1e-3)


def test_points_of_weight_zero_do_not_count():
    problem, state = problem_of(count=3)
    weights = [np.ones(len(v)) for v in problem.views]
    weights[1][:20] = 0.0
    views = list(problem.views)
    views[1] = views[1].take(slice(20, None))
    fewer = Problem(problem.lens, views, problem.free)
    cost = Problem(problem.lens, problem.views, problem.free, weights=weights).linearise(state).cost
    assert cost == pytest.approx(
        fewer.linearise(fewer.state(state.params, problem.poses(state))).cost, rel=1e-12
    )


def test_a_point_behind_the_camera_has_no_cost():
    problem, state = problem_of()
    behind = replace(state, centres=state.centres * [1, 1, -1])
    assert problem.linearise(behind) is None
    assert problem.view_normals(behind) is None
    assert np.isnan(problem.pose_normals(behind, np.arange(len(problem.views)))).any()


def test_coordinates_far_from_the_origin_keep_the_digits():
    near, state = problem_of()
    far, far_state = problem_of(offset=1e5)
    a, b = near.linearise(state), far.linearise(far_state)
    # 1e5 + 8 squares of a board keep 16 - 5 digits of the coordinates
    assert b.cost == pytest.approx(a.cost, rel=1e-8)
    np.testing.assert_allclose(b.poses, a.poses, rtol=1e-6, atol=1e-2)


def test_the_ideal_board_has_the_flat_problem_s_cost():
    flat, state = problem_of()
    board, board_state = problem_of(board="free")
    assert board.linearise(board_state).cost == pytest.approx(flat.linearise(state).cost, rel=1e-13)
    assert board.variables == flat.variables + board.board.size


def test_a_problem_without_free_parameters():
    problem, state = problem_of(fix=dict.fromkeys(solved.TRUTH))
    blocks = problem.linearise(state)
    assert problem.variables == 0 and blocks.intrinsics.shape == (0, 0) and blocks.cost > 0
