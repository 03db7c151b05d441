"""Suggestion of additional poses that determine X best."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from camcal.data.observations import View
from camcal.geometry import rotations as so3
from camcal.model.pose import Array, Pose, Poses
from camcal.records import dataclass
from camcal.routes.hand_eye import equation, variance
from camcal.routes.hand_eye.estimate import Estimate
from camcal.routes.hand_eye.joint import Joint, Measured, Unknowns
from camcal.solve.problem import Problem

#: Rotations of the camera about the board's centroid, degrees about its axes, starting from a view. Most boards and
#: wrists permit 30 degrees; a rotation about the optical axis loses no corners.
TURNS = tuple(
    (30.0 * a, 30.0 * b, c)
    for a in (-1, 0, 1)
    for b in (-1, 0, 1)
    for c in (-60.0, 0.0, 60.0)
    if (a, b, c) != (0, 0, 0)
)
#: views from which rotations are tried, spread over all
BASES = 8
#: rad; angle of the line of sight to the board's plane: at sin(15 degrees) = 0.26 the squares are foreshortened to a
#: quarter
FLATTEST = np.radians(15)


@dataclass(frozen=True)
class Suggestion:
    """A pose of the hand, the camera's view there, and the sigmas (6,) of X with it and the preceding ones."""

    base_from_hand: Pose
    cam_from_board: Pose
    sigma: Array


def suggest(found: Estimate, count: int = 3) -> list[Suggestion]:
    """The poses that reduce the variances of X most, chosen one by one, each given the preceding ones.

    The product of the six variances is minimised, whose order does not depend on units. Only poses at which the camera
    sees the whole board are tried; whether the robot can reach them is not known.
    """
    poses, view = _candidates(found)
    if not len(poses):
        return []
    information = _information(found, poses, view)
    present = np.linalg.inv(found.covariance)
    reached = equation.robot_pose(found.setup, found.x, found.z, poses)
    made = []
    for _ in range(count):
        variances = np.diagonal(np.linalg.inv(present + information), axis1=1, axis2=2)[:, :6]
        best = int(np.log(variances).sum(1).argmin())
        present = present + information[best]
        made.append(Suggestion(reached[best], poses[best], np.sqrt(variances[best])))
    return made


def _candidates(found: Estimate) -> tuple[Poses, View]:
    """Poses cam_from_board (K,) at which all points of the largest view are visible, and that view."""
    view = max(
        (v for v, c in zip(found.pictures.views, found.pictures.seen.camera, strict=True) if c == 0), key=len
    )
    middle, camera = view.xyz.mean(0), found.pictures.camera
    bases = found.poses[np.unique(np.linspace(0, len(found.poses) - 1, BASES).round().astype(int))]
    turns = so3.exp(np.radians(TURNS))
    rotation = (turns[None] @ bases.rotation[:, None]).reshape(-1, 3, 3)
    centre = np.repeat(bases.rotation @ middle + bases.translation, len(turns), 0)
    poses = Poses(rotation, centre - rotation @ middle)
    uv = camera.project(poses[:, None].apply(view.xyz))
    low, high = np.zeros(2), camera.image_size
    if high is None:
        low, high = view.uv.min(0), view.uv.max(0) + 1
    with np.errstate(invalid="ignore"):
        inside = ((uv >= low) & (uv <= np.subtract(high, 1))).all((1, 2))
    # the front of the board
    side = np.einsum("ki,ki->k", rotation[:, :, 2], centre) / np.linalg.norm(centre, axis=1)
    before = np.einsum("vi,vi->v", bases.rotation[:, :, 2], bases.rotation @ middle + bases.translation)
    inside &= side * np.repeat(np.sign(before), len(turns)) > np.sin(FLATTEST)
    return poses[np.flatnonzero(inside)], view


def _information(found: Estimate, poses: Poses, view: View) -> Array:
    """Aᵀ V⁻¹ A (K, 12, 12) of one additional pose each."""
    camera = found.pictures.camera
    views = [replace(view, id=str(i), uv=camera.project(p.apply(view.xyz))) for i, p in enumerate(poses)]
    problem = Problem(camera.lens, views, np.zeros((camera.lens.size, 0)))
    measured = Measured(equation.robot_pose(found.setup, found.x, found.z, poses), np.zeros((len(poses), 6)))
    joint = Joint(found.setup, problem, lambda offset: measured, found.noise)
    linear = joint.linear(Unknowns(problem.state(camera.params, poses), found.x, found.z))
    weights = variance.weights(linear, found.noise, 1.0)
    return np.einsum("vif,vij,vjg->vfg", linear.by_shared, weights, linear.by_shared)
