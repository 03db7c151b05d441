"""Properties of poses over batch shapes. What these do not prove: which way the calibration's own poses go."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camcal.geometry import rotations
from camcal.model.pose import Pose, Poses

SHAPES = [(), (1,), (3,), (0,), (2, 3), (4, 1)]
#: products of a few matrices of entries up to 1 and translations up to 10: a hundred roundings
EPS = 1e-13
seeds = st.integers(0, 2**32 - 1)


def some(seed, shape=()):
    rng = np.random.default_rng(seed)
    return Pose.from_vector(rng.normal(size=(*shape, 3)), rng.uniform(-10, 10, (*shape, 3)))


def same(a, b):
    np.testing.assert_allclose(a.matrix, b.matrix, rtol=0, atol=EPS * 10)


@pytest.mark.parametrize("shape", SHAPES)
@given(seeds)
def test_inverse_and_composition(shape, seed):
    a, b, c = some(seed, shape), some(seed + 1, shape), some(seed + 2, shape)
    assert a.shape == shape and (a @ b).shape == shape and isinstance(a, Poses) == bool(shape)
    same(a @ a.inverse(), Pose(np.broadcast_to(np.eye(3), (*shape, 3, 3)), np.zeros((*shape, 3))))
    same((a @ b) @ c, a @ (b @ c))
    same((a @ b).inverse(), b.inverse() @ a.inverse())
    np.testing.assert_allclose((a @ b).matrix, a.matrix @ b.matrix, rtol=0, atol=10 * EPS)
    points = np.random.default_rng(seed).normal(size=(*shape, 3))
    np.testing.assert_allclose((a @ b).apply(points), a.apply(b.apply(points)), rtol=0, atol=10 * EPS)
    np.testing.assert_allclose(a.inverse().apply(a.apply(points)), points, rtol=0, atol=10 * EPS)
    np.testing.assert_allclose(a.apply(a.centre), np.zeros((*shape, 3)), rtol=0, atol=10 * EPS)


@pytest.mark.parametrize("left, right", [((), (3,)), ((3,), ()), ((2, 1), (3,)), ((4, 1), (1, 3))])
@given(seeds)
def test_batch_axes_broadcast(left, right, seed):
    a, b = some(seed, left), some(seed + 1, right)
    product = a @ b
    shape = np.broadcast_shapes(left, right)
    assert product.shape == shape
    for index in np.ndindex(*shape):
        one = [
            Pose(
                np.broadcast_to(p.rotation, (*shape, 3, 3))[index],
                np.broadcast_to(p.translation, (*shape, 3))[index],
            )
            for p in (a, b)
        ]
        same(product[index], one[0] @ one[1])


@given(seeds)
def test_one_pose_takes_points_of_any_shape(seed):
    pose, points = some(seed), np.random.default_rng(seed).normal(size=(2, 5, 3))
    moved = pose.apply(points)
    np.testing.assert_allclose(moved[1, 2], pose.rotation @ points[1, 2] + pose.translation, rtol=0, atol=EPS)


@given(seeds)
def test_each_pose_on_all_points(seed):
    poses, points = some(seed, (4,)), np.random.default_rng(seed).normal(size=(7, 3))
    moved = poses[:, None].apply(points)
    assert moved.shape == (4, 7, 3)
    np.testing.assert_allclose(moved, [p.apply(points) for p in poses], rtol=0, atol=EPS)


def test_a_sequence_of_poses():
    poses = some(1, (4,))
    assert len(poses) == 4 and len(poses[1:]) == 3 and len(poses[np.array([True, False, True, False])]) == 2
    assert type(poses[0]) is Pose and type(poses[np.int64(3)]) is Pose and type(poses[1:]) is Poses
    again = Poses.stack(list(poses))
    np.testing.assert_array_equal(again.rotations, poses.rotations)
    np.testing.assert_array_equal(again.translations, poses.translations)
    assert Poses.stack([]).shape == (0,) and list(Poses.stack([])) == []


@given(st.lists(st.floats(-1.7, 1.7), min_size=3, max_size=3))
def test_rotation_vector(vector):
    pose = Pose.from_vector(np.array(vector), np.zeros(3))
    np.testing.assert_allclose(pose.rotation_vector, vector, rtol=0, atol=1e-12)


def test_repr_is_one_line():
    pose = Pose(rotations.exp(np.array([0, 0, np.pi / 6])), np.array([1.0, 2, 3]))
    assert repr(pose) == "<Pose 30 deg, translation (1, 2, 3)>"
    assert repr(some(0, (13,))) == "<Poses 13>"
