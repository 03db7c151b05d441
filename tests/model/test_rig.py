"""Rigs: frames, relative poses, and what is refused."""

import re

import numpy as np
import pytest

from camcal.errors import UsageError
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from camcal.model.rig import ROTATION_TOLERANCE, Rig

LENS = lenses.make("pinhole")
LEFT, RIGHT, TOP = (Camera(LENS, LENS.pinhole(f, f, 320, 240), (640, 480)) for f in (500.0, 510.0, 900.0))
RIGHT_FROM_RIG = Pose.from_vector(np.array([0.01, -0.2, 0.03]), np.array([-0.3, 0.4, 0.0]))
TOP_FROM_RIG = Pose.from_vector(np.array([0.5, 0.1, 0.0]), np.array([0.0, 0.2, 0.1]))
CAMERAS = {"left": LEFT, "right": RIGHT, "top": TOP}
RIG = Rig(CAMERAS, {"right": RIGHT_FROM_RIG, "top": TOP_FROM_RIG}, "left")


def test_relative_poses():
    assert RIG.baseline("left", "right") == pytest.approx(0.5)
    point = np.array([0.1, -0.2, 4.0])
    in_top, in_right = TOP_FROM_RIG.apply(point), RIGHT_FROM_RIG.apply(point)
    np.testing.assert_allclose(RIG.relative("top", "right").apply(in_right), in_top, rtol=0, atol=1e-14)
    seen = RIG.project(point)
    assert list(seen) == ["left", "right", "top"]
    np.testing.assert_allclose(seen["right"], RIGHT.project(in_right), rtol=0, atol=1e-12)
    np.testing.assert_allclose(seen["left"], LEFT.project(point), rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", CAMERAS)
def test_another_reference_changes_no_relative_pose(name):
    moved = RIG.with_reference(name)
    assert moved.reference == name and list(moved.cameras) == list(CAMERAS)
    np.testing.assert_array_equal(moved.cam_from_rig[name].matrix, np.eye(4))
    for to in CAMERAS:
        for source in CAMERAS:
            np.testing.assert_allclose(
                moved.relative(to, source).matrix, RIG.relative(to, source).matrix, rtol=0, atol=1e-14
            )


def test_from_poses_in_the_world():
    world = Pose.from_vector(np.array([0.4, 1.0, -2.0]), np.array([5.0, 6.0, 7.0]))
    rig = Rig.in_frame_of("left", CAMERAS, {n: p @ world for n, p in RIG.cam_from_rig.items()})
    np.testing.assert_allclose(rig.cam_from_rig["top"].matrix, TOP_FROM_RIG.matrix, rtol=0, atol=1e-14)


def test_one_camera_is_a_rig():
    assert repr(Rig({"cam": LEFT}, {}, "cam")) == "<Rig cam: pinhole; reference cam>"


def test_it_is_frozen():
    with pytest.raises(TypeError, match="does not support item assignment"):
        RIG.cameras["other"] = LEFT


def scaled(part):
    return Pose(RIGHT_FROM_RIG.rotation * (1 + part), RIGHT_FROM_RIG.translation)


MIRRORED = Pose(np.diag([1.0, 1.0, -1.0]), np.zeros(3))
NOWHERE = Pose(np.eye(3), np.array([0.0, np.nan, 0.0]))
TWO = Pose.from_vector(np.zeros((2, 3)), np.zeros((2, 3)))


@pytest.mark.parametrize(
    "poses, reference, said",
    [
        ({}, "left", "no pose of the camera 'right'"),
        (
            {"right": RIGHT_FROM_RIG, "bottom": RIGHT_FROM_RIG},
            "left",
            "a pose of 'bottom', but no such camera",
        ),
        ({"right": RIGHT_FROM_RIG}, "middle", "the reference camera 'middle' is not among"),
        (
            {"left": RIGHT_FROM_RIG, "right": RIGHT_FROM_RIG},
            "left",
            "reference camera 'left' is not the identity",
        ),
        ({"right": scaled(ROTATION_TOLERANCE)}, "left", "'right' is not a rigid transformation"),
        ({"right": MIRRORED}, "left", "'right' is not a rigid transformation"),
        ({"right": NOWHERE}, "left", "'right' is not a rigid transformation"),
        ({"right": TWO}, "left", "'right' is not a single rotation"),
    ],
)
def test_refused(poses, reference, said):
    with pytest.raises(UsageError, match=re.escape(said)):
        Rig({"left": LEFT, "right": RIGHT}, poses, reference)


def test_rounding_of_a_rotation_is_no_fault():
    Rig({"left": LEFT, "right": RIGHT}, {"right": scaled(ROTATION_TOLERANCE / 3)}, "left")
