"""The input of the closed forms: the poses of the views, their motions, and the equations of the translations."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from camcal.geometry import rotations as so3
from camcal.model.pose import Array, Pose, Poses
from camcal.records import dataclass

#: Largest number of pairs of views; those closest in the list are omitted first. All pairs of 64 views; more cost time
#: and add no information, as V views have only V - 1 independent motions.
MOST_MOTIONS = 2016


@dataclass(frozen=True)
class Views:
    """The two poses of each view in the equation G Z = X C.

    Attributes
    ----------
    robot : Poses
        G (V,).
    camera : Poses
        C (V,), cam_from_board.
    """

    robot: Poses
    camera: Poses

    def __len__(self) -> int:
        return len(self.robot)

    @cached_property
    def pairs(self) -> tuple[Array, Array]:
        """Indices (M,), (M,) of the pairs of views, the later one first."""
        j, i = np.triu_indices(len(self), 1)
        order = np.argsort(-(i - j), kind="stable")[:MOST_MOTIONS]
        return i[order], j[order]

    @cached_property
    def motions(self) -> tuple[Poses, Poses]:
        """A = G_i G_j⁻¹ and B = C_i C_j⁻¹ of the pairs, A X = X B."""
        i, j = self.pairs
        return self.robot[i] @ self.robot[j].inverse(), self.camera[i] @ self.camera[j].inverse()

    def second(self, x: Pose) -> Pose:
        """Z from X: the mean of G_i⁻¹ X C_i."""
        each = self.robot.inverse() @ x @ self.camera
        return Pose(so3.nearest(each.rotation.sum(0)), each.translation.mean(0))

    def from_rotation(self, rotation: Array) -> tuple[Pose, Pose]:
        """X and Z from the rotation of X: least squares for (R_A − I) t_X = R_X t_B − t_A."""
        a, b = self.motions
        left = (a.rotation - np.eye(3)).reshape(-1, 3)
        right = (b.translation @ rotation.T - a.translation).ravel()
        x = Pose(rotation, np.linalg.lstsq(left, right, rcond=None)[0])
        return x, self.second(x)

    def from_rotations(self, of_x: Array, of_z: Array) -> tuple[Pose, Pose]:
        """X and Z from both rotations."""
        g, c = self.robot, self.camera
        x, z = from_rotations(
            g.rotation[None], g.translation[None], c.translation[None], of_x[None], of_z[None]
        )
        return Pose(x.rotation[0, 0], x.translation[0, 0]), Pose(z.rotation[0, 0], z.translation[0, 0])

    def robot_poses(self, setup: str) -> Poses:
        """base_from_hand (V,) of a set-up."""
        found: Any = self.robot.inverse() if setup == "in-hand" else self.robot
        return found


def views_of(setup: str, base_from_hand: Poses, cam_from_board: Poses) -> Views:
    """The views of a set-up from the robot's poses and the camera's (V,)."""
    robot: Any = base_from_hand.inverse() if setup == "in-hand" else base_from_hand
    return Views(robot, cam_from_board)


def from_rotations(
    robot: Array, robot_places: Array, camera_places: Array, of_x: Array, of_z: Array
) -> tuple[Pose, Pose]:
    """X and Z of S samples of V views, with the axes (S, 1): least squares for R_G t_Z − t_X = R_X t_C − t_G.

    Parameters
    ----------
    robot : (S, V, 3, 3) array
        Rotations of G.
    robot_places, camera_places : (S, V, 3) arrays
        Translations of G and C.
    of_x, of_z : (S, 3, 3) arrays
    """
    samples = len(robot)
    left = np.concatenate([robot, np.broadcast_to(-np.eye(3), robot.shape)], 3).reshape(samples, -1, 6)
    right = (camera_places @ np.swapaxes(of_x, 1, 2) - robot_places).reshape(samples, -1, 1)
    t = (np.linalg.pinv(left) @ right)[:, None, :, 0]
    return Pose(of_x[:, None], t[..., 3:]), Pose(of_z[:, None], t[..., :3])
