"""Poses alone: every view its own minimum."""

from dataclasses import replace

import numpy as np
import pytest

from camcal.geometry import rotations
from camcal.model.pose import Poses
from camcal.solve.poses import refine_poses, solve_poses
from tests import solved
from tests.solve.problems import cost_of, problem_of, views_of


def disturbed(poses, angle=0.05, shift=0.3, seed=4):
    rng = np.random.default_rng(seed)
    turn = rotations.exp(rng.normal(0, angle, (len(poses), 3)))
    return Poses(turn @ poses.rotations, poses.translations + rng.normal(0, shift, (len(poses), 3)))


@pytest.mark.parametrize("model", ["opencv5", "kb4"])
def test_exact_views_give_their_poses(model):
    camera = solved.camera_of()
    if model == "kb4":
        camera = solved.camera_of("kb4", {})
        camera = replace(camera, params=camera.lens.examples()[0][0])
    views, truth = views_of(camera, count=6, noise=0.0, ragged=True)
    found, costs, converged = refine_poses(camera, views, disturbed(truth))
    assert converged.all() and (costs < 1e-18).all()
    # exact data: what rounding of the pixels leaves, times the geometry
    assert rotations.angle_between(found.rotations, truth.rotations).max() < 1e-10
    np.testing.assert_allclose(found.translations, truth.translations, atol=1e-9)


def test_each_view_alone_gives_the_same():
    camera = solved.camera_of()
    views, truth = views_of(camera, count=4, noise=0.3)
    together, costs, _ = refine_poses(camera, views, disturbed(truth))
    for i, view in enumerate(views):
        alone, cost, _ = refine_poses(camera, [view], disturbed(truth)[i : i + 1])
        assert costs[i] == pytest.approx(cost[0], rel=1e-10)
        np.testing.assert_allclose(together.translations[i], alone.translations[0], atol=1e-6)


def test_a_view_behind_the_camera_does_not_stop_the_others():
    camera = solved.camera_of()
    # 400 points: each view is a group of its own
    views, truth = views_of(camera, count=3, noise=0.1, xyz=solved.grid(24, 20, 0.35))
    start = disturbed(truth, 0.01, 0.05)
    start.translations[1] *= [1, 1, -1]
    _, costs, converged = refine_poses(camera, views, start)
    assert np.isinf(costs[1]) and not converged[1]
    assert np.isfinite(costs[[0, 2]]).all() and converged[[0, 2]].all()


def test_the_rest_of_the_state_stays():
    problem, state = problem_of(board="bowl")
    state = replace(state, shape=np.array([0.01, -0.02]))
    found = solve_poses(problem, state)
    np.testing.assert_array_equal(found.state.shape, state.shape)
    np.testing.assert_array_equal(found.state.params, state.params)
    assert found.converged.all() and found.passes >= 2
    assert found.costs.sum() == pytest.approx(cost_of(problem, found.state), rel=1e-12)
    blocks = problem.linearise(found.state)
    left = np.linalg.solve(blocks.poses, blocks.pose_gradients[..., None])[..., 0]
    # what another undamped step would gain, of the cost
    assert 0.5 * (left * blocks.pose_gradients).sum() < 1e-11 * blocks.cost


def test_no_iterations_change_nothing():
    camera = solved.camera_of()
    views, truth = views_of(camera, count=2)
    start = disturbed(truth)
    found, _, converged = refine_poses(camera, views, start, max_iterations=0)
    np.testing.assert_allclose(found.translations, start.translations, atol=1e-12)
    assert not converged.any()
