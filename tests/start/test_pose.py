"""Poses of views whose rays are known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from camcal.data.observations import Correspondences
from camcal.errors import DataError
from camcal.geometry import rotations
from camcal.model.pose import Poses
from camcal.start import pose
from tests.start import scenes

IDENTITY = np.eye(3)


def cost(poses, xyz, ab):
    x = xyz @ np.swapaxes(poses.rotations, 1, 2) + poses.translations[:, None]
    return ((x[..., :2] / x[..., 2:] - ab) ** 2).sum((1, 2))


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 2**32 - 1), st.sampled_from(["board", "bowed", "shallow", "rig"]))
def test_exact_data_give_the_pose(seed, kind):
    random = np.random.default_rng(seed)
    points = {"rig": scenes.rig()}.get(kind, scenes.board())
    points = points + random.normal(size=points.shape) * [
        0,
        0,
        {"bowed": 0.001, "shallow": 0.01}.get(kind, 0),
    ]
    turns = random.normal(size=(4, 3)) * [0.4, 0.4, 2]
    scene = scenes.scene(points, turns, IDENTITY, seed=seed % 1000)
    views = scene.observations.views
    found = pose.initial_poses([v.xyz for v in views], [v.uv for v in views])
    # a start within 1e-6 of its error's minimum, which for exact data is 0
    angle, distance = scenes.pose_error(found, scene.poses)
    assert angle < 1e-5 and distance < 1e-5


def test_pixels_of_a_pinhole_camera():
    scene = scenes.scene(scenes.board(), scenes.tilts(5))
    assert scenes.pose_error(pose.poses_for(scenes.K, scene.observations), scene.poses)[0] < 1e-8


def test_small_distant_boards_take_the_better_of_two_minima():
    points = scenes.board() * 0.2
    random = np.random.default_rng(0)
    turns = random.normal(size=(300, 3)) * 0.5
    scene = scenes.scene(points, turns, IDENTITY, noise=2e-4)
    xyz = np.stack([v.xyz for v in scene.observations.views])
    ab = np.stack([v.uv for v in scene.observations.views])
    found = pose.initial_poses(list(xyz), list(ab))
    # the lowest minimum lies below the error of the true pose
    assert (cost(found, xyz, ab) <= cost(scene.poses, xyz, ab) * (1 + 1e-6)).mean() > 0.98
    # and the homography alone does not reach it: what the search for the second one is for
    first = pose.initial_poses(list(xyz), list(ab), steps=0)
    wrong = (rotations.angle_between(p.rotations, scene.poses.rotations) > 0.2 for p in (found, first))
    few, many = (int(w.sum()) for w in wrong)
    assert few < 0.5 * many


def test_the_second_solution_is_its_own_inverse():
    scene = scenes.scene(scenes.board(), scenes.tilts(4))
    there = pose.second_solution(scene.poses)
    np.testing.assert_allclose(np.linalg.det(there.rotations), 1)
    np.testing.assert_allclose(pose.second_solution(there).rotations, scene.poses.rotations, atol=1e-13)


def test_poses_of_the_data_s_frame():
    """x_cam is the same through the plane's frame and through the composed pose."""
    random = np.random.default_rng(2)
    plane = Poses(rotations.exp(random.normal(size=(3, 3))), random.normal(size=(3, 3)))
    origins, axes = random.normal(size=(3, 3)), rotations.exp(random.normal(size=(3, 3)))
    x = random.normal(size=(3, 3))
    composed = pose.from_plane(plane, origins, axes)
    for i in range(3):
        np.testing.assert_allclose(
            composed[i].apply(x[i]), plane[i].apply(axes[i].T @ (x[i] - origins[i])), atol=1e-13
        )


def test_weights_are_taken():
    scene = scenes.scene(scenes.board(), scenes.tilts(3), IDENTITY)
    xyz = [v.xyz for v in scene.observations.views]
    ab = [v.uv + np.eye(54)[5][:, None] * 0.05 for v in scene.observations.views]
    sigma = np.ones(54)
    sigma[5] = 1e6
    weighted = pose.initial_poses(xyz, ab, [sigma] * 3)
    plain = pose.initial_poses(xyz, ab)
    assert scenes.pose_error(weighted, scene.poses)[0] < 1e-5 < scenes.pose_error(plain, scene.poses)[0]


def test_polish_lowers_the_error_to_a_minimum():
    scene = scenes.scene(scenes.rig(), scenes.tilts(6), IDENTITY, noise=1e-3)
    xyz = np.stack([v.xyz for v in scene.observations.views])
    ab = np.stack([v.uv for v in scene.observations.views])
    w = np.ones(xyz.shape[:2])
    found = pose.polish(scene.poses, xyz, ab, w, 30)
    np.testing.assert_allclose(found.cost, cost(found.poses, xyz, ab), rtol=1e-10)
    assert (found.cost < cost(scene.poses, xyz, ab)).all()
    for axis in range(6):
        for step in (1e-3, -1e-3):
            d = np.eye(6)[axis] * step
            beside = Poses(rotations.exp(d[:3]) @ found.poses.rotations, found.poses.translations + d[3:])
            assert (cost(beside, xyz, ab) > found.cost).all()


def test_a_view_of_too_few_points_is_refused():
    with pytest.raises(DataError, match="view '1': 3 points; at least 4 on a plane"):
        pose.initial_poses([scenes.board()[[0, 1, 10]]], [np.zeros((3, 2))])


def test_no_view_gives_no_pose():
    with pytest.raises(DataError, match="no view"):
        pose.poses_for(scenes.K, Correspondences.from_views(()))
