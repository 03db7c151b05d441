"""Alternative coordinates of rotations, used only for comparison with perturbations on the left.

The unknowns of a pose become the rotation vector itself, the three Euler angles, or the four numbers of a
quaternion, to which steps are added. The optimum is the same, but the path to it is not, and the equations become
ill-conditioned near singularities: Euler angles at ±90 degrees, rotation vectors at 180 degrees and beyond.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from camcal.geometry import rotations
from camcal.solve.problem import Blocks, Problem, State, Step

Array = np.ndarray


class OtherRotations:
    """A problem with other coordinates of poses; poses are V rows of 6, or of 7 with quaternions.

    For methods that use only the linearisations and retractions of a problem.
    """

    def __init__(self, problem: Problem, kind: str):
        self.problem, self.kind = problem, kind
        self.parameters, self.views, self.free = problem.parameters, problem.views, problem.free
        self.rounding, self.normalise = problem.rounding, problem.normalise
        self.point_coordinates = None  # for comparisons: always the poses first

    def linearise(self, state: State) -> Blocks | None:
        """The normal equations with respect to the other coordinates."""
        blocks = self.problem.linearise(state)
        if blocks is None:
            return None
        turn = derivatives(self.kind, state.rotations)
        size = turn.shape[2] + 3
        chain = np.zeros((len(turn), 6, size))
        chain[:, :3, :-3], chain[:, 3:, -3:] = turn, np.eye(3)
        poses = chain.transpose(0, 2, 1) @ blocks.poses @ chain
        if self.kind == "quaternion":  # its length has no effect: constrain it as strongly as the rest
            q = rotations.quaternion(state.rotations)
            held = np.einsum("vii->v", blocks.poses[:, :3, :3]) / 3
            poses[:, :4, :4] += held[:, None, None] * q[:, :, None] * q[:, None, :]
        return replace(
            blocks,
            coupling=blocks.coupling @ chain,
            poses=poses,
            pose_gradients=np.einsum("vi,vij->vj", blocks.pose_gradients, chain),
        )

    def retract(self, state: State, step: Step) -> State:
        """Add to the coordinates."""
        moved = self.problem.retract(state, Step(step.intrinsics, np.zeros((len(step.poses), 6))))
        turned = to_rotations(self.kind, coordinates(self.kind, state.rotations) + step.poses[:, :-3])
        return replace(moved, rotations=turned, centres=state.centres + step.poses[:, -3:])


def coordinates(kind: str, r: Array) -> Array:
    """Coordinates (V, 3) or (V, 4) of rotation matrices (V, 3, 3)."""
    if kind == "vector":
        return rotations.log(r)
    if kind == "quaternion":
        return rotations.quaternion(r)
    return np.array([rotations.to_euler(one) for one in r])


def to_rotations(kind: str, c: Array) -> Array:
    """Rotation matrices of coordinates."""
    if kind == "vector":
        return rotations.exp(c)
    if kind == "quaternion":
        return rotations.from_quaternion(c)
    return np.array([rotations.from_euler(*one) for one in c])


def derivatives(kind: str, r: Array) -> Array:
    """d (perturbation on the left) / d coordinates, (V, 3, 3 or 4), at rotation matrices (V, 3, 3)."""
    c = coordinates(kind, r)
    if kind == "vector":
        return rotations.left_jacobian(c)
    if kind == "quaternion":
        scalar, vector = c[:, :1, None], c[:, 1:]
        return 2 * np.concatenate([-vector[..., None], scalar * np.eye(3) + rotations.skew(vector)], 2)
    # R = Rz(θ) Ry(β) Rx(α): α turns about Rz Ry x, β about Rz y, θ about z
    out = np.zeros((len(c), 3, 3))
    out[:, 2, 2] = 1.0
    for i, (_, beta, theta) in enumerate(c):
        out[i, :, 0] = rotations.from_euler(0.0, beta, theta)[:, 0]
        out[i, :, 1] = rotations.from_euler(0.0, 0.0, theta)[:, 1]
    return out
