"""Which way views counted the points of boards that look the same after a turn."""

import numpy as np
import pytest

from camcal.geometry import rotations
from camcal.model.pose import Pose, Poses
from camcal.plan.rig_turns import SAME_ANGLE, SAMPLES, _samples, _ways, chosen_turns

HALF = Pose(rotations.exp(np.array([0, 0, np.pi])), np.zeros(3))
CORNERS = np.array([[x, y, 0.0] for x in (-1, 1) for y in (-1, 1)])


def about_y(angles):
    return [Pose(rotations.exp(np.array([0, a, 0])), np.array([0, 0, 5.0])) for a in angles]


@pytest.mark.parametrize(("off", "kept"), [(0.9 * SAME_ANGLE, True), (1.1 * SAME_ANGLE, False)])
def test_motions_of_both_sides_have_one_angle(off, kept):
    robot = Poses.stack([Poses.stack([p]) for p in about_y([0, 0.4, 0.8])])
    camera = Poses.stack([Poses.stack([p]) for p in about_y([0, 0.4, 0.8 + off])])
    assert (len(list(_ways(robot, camera))) == 1) == kept


def test_views_of_one_instant_are_turned_to_most_of_them():
    board = about_y([0.3])[0]
    poses = Poses.stack([Poses.stack([p, p @ HALF]) for p in (board, board @ HALF, board)])
    np.testing.assert_array_equal(chosen_turns(poses, np.full(3, 1e-6), CORNERS), [0, 1, 0])


@pytest.mark.parametrize(("count", "many"), [(2, 0), (3, 1), (5, 10), (12, SAMPLES), (100_000, SAMPLES)])
def test_samples_are_different_instants_and_no_list_of_all(count, many):
    found = [tuple(sample.tolist()) for sample in _samples(count)]
    assert len(found) == len(set(found)) == many
    assert all(0 <= i < j < k < count for i, j, k in found)
