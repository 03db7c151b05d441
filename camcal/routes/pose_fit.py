"""One pose of a known camera by least squares in px."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from camcal.geometry import rotations
from camcal.least_squares.blocks import BlockNormal, Fitted, minimise
from camcal.model.camera import Camera
from camcal.model.pose import Array, Pose


def refine_pose(camera: Camera, xyz: Array, uv: Array, roots: Array, start: Pose) -> Fitted[Pose] | None:
    """The minimum of Σ (roots |r|)² near a pose, cam_from_world; None if the start is outside the domain.

    Parameters
    ----------
    xyz : (N, 3) array
    uv : (N, 2) array, px
    roots : (N,) array
        1 / sigma of each point.
    """

    def linearise(pose: Pose) -> BlockNormal | None:
        made = weighted_jacobian(camera, xyz, uv, roots, pose)
        return None if made is None else BlockNormal.dense(*made)

    return minimise(linearise, lambda pose, step, _: moved(pose, step), start)


def moved(pose: Pose, step: Array) -> Pose:
    """The pose after a step (6,): rotation on the left, translation."""
    return replace(
        pose, rotation=rotations.exp(step[:3]) @ pose.rotation, translation=pose.translation + step[3:]
    )


def weighted_jacobian(
    camera: Camera, xyz: Array, uv: Array, roots: Array, pose: Pose
) -> tuple[Array, Array] | None:
    """Residuals (2N,) and Jacobian (2N, 6) by rotation and translation, times the roots (N,) of the weights.

    None where a point is outside the lens's domain.
    """
    turned = xyz @ pose.rotation.T
    projected, d_xyz, _, valid = camera.lens.jacobians(camera.params, turned + pose.translation)
    if not valid.all():
        return None
    jacobian = np.concatenate([-d_xyz @ rotations.skew(turned), d_xyz], 2) * roots[:, None, None]
    residual = (projected - uv) * roots[:, None]
    return residual.ravel(), jacobian.reshape(-1, 6)
