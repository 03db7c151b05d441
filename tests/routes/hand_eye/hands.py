"""Simulated robots with a camera in the hand, or one beside them."""

from typing import NamedTuple

import numpy as np

from camcal.data.observations import View
from camcal.geometry import rotations as so3
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose, Poses
from camcal.routes.hand_eye.equation import robot_pose
from camcal.routes.hand_eye.pictures import Pictures

CAMERA = Camera(lenses.make("pinhole"), np.array([600.0, 600, 319.5, 239.5]), (640, 480))
BOARD = np.c_[np.stack(np.meshgrid(np.arange(9.0), np.arange(6.0)), -1).reshape(-1, 2) * 25, np.zeros(54)]
#: X and Z; lengths in mm
TRUTH = {
    "in-hand": (
        Pose.from_vector((0.1, -0.05, 1.57), (50, -30, 40)),
        Pose.from_vector((3, 0.1, 0.05), (550, 40, 10)),
    ),
    "to-hand": (
        Pose.from_vector((-1.2, 1.25, -1.1), (900, -60, 450)),
        Pose.from_vector((0.2, -0.1, 0.7), (10, 20, 60)),
    ),
}


class Hand(NamedTuple):
    setup: str
    x: Pose
    z: Pose
    pictures: Pictures
    robot: Poses  #: as measured


def cameras(rng, count, turn=0.5, roll=1.0):
    """cam_from_board (V,): the board in the middle of the picture, turned by up to `turn` rad and `roll` more."""
    rotation = so3.exp(
        rng.uniform(-turn, turn, (count, 3)) + np.c_[np.zeros((count, 2)), rng.uniform(-roll, roll, count)]
    )
    centre = np.c_[rng.uniform(-30, 30, count), rng.uniform(-20, 20, count), rng.uniform(350, 480, count)]
    return Poses(rotation, centre - rotation @ BOARD.mean(0))


def pictures_of(poses, rng, px):
    views = tuple(
        View(f"v{i:02d}", BOARD, CAMERA.project(p.apply(BOARD)) + rng.normal(0, px, (54, 2)))
        for i, p in enumerate(poses)
    )
    return Pictures(CAMERA, views, poses, None, np.zeros((len(poses), 6, 0)), np.zeros((0, 0)))


def noisy(robot, rng, mm, deg):
    turn = so3.exp(rng.normal(0, np.radians(deg), (len(robot), 3)))
    return Poses(robot.rotation @ turn, robot.translation + rng.normal(0, mm, (len(robot), 3)))


def hand(setup, seed, count=15, mm=1.0, deg=0.1, px=0.2, poses=None):
    rng = np.random.default_rng(seed)
    poses = cameras(rng, count) if poses is None else poses
    pictures = pictures_of(poses, rng, px)
    robot = noisy(robot_pose(setup, *TRUTH[setup], poses), rng, mm, deg)
    return Hand(setup, *TRUTH[setup], pictures, robot)


def off(found, truth):
    """Rotation (left, rad) and translation (6,) of a pose less the truth."""
    return np.r_[so3.log(found.rotation @ truth.rotation.T), found.translation - truth.translation]
