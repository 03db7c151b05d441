"""The joint estimate of X, Z and all poses of the views, from the pictures and the robot's poses.

    minimise  ½ Σ w |project(C_i x) − u|² / s² + ½ Σ |log(R_B R_Mᵀ)|² / s_r² + |t_B − t_M|² / s_t²            (1)

over X, Z and every C_i, where B_i is the robot's pose that they imply and M_i the measured one (see `equation`). The
poses of the views are blocks that are eliminated first. With a stream of poses, the offset of its clock is a further
unknown: M_i is the stream at t_i + offset.

A camera that was calibrated from the same pictures is estimated jointly. Its errors z, scaled to variance 1 given the
pictures (`Pictures.camera_root`), move the pose from picture i by S_i z. In (1), C_i is moved accordingly and ½ |z|² is
added: to first order this is the pictures' likelihood including the camera's parameters.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field, replace
from typing import Any, NamedTuple

import numpy as np

from camcal.geometry import rotations as so3
from camcal.least_squares import Options, Trial, minimise
from camcal.least_squares.blocks import BlockNormal
from camcal.model.pose import Array, Pose, Poses
from camcal.records import dataclass
from camcal.routes.hand_eye import equation
from camcal.solve.problem import Problem, State


class Noise(NamedTuple):
    """Standard deviations of an image coordinate (px), of a rotation about one axis (rad), and of a translation
    along one axis.
    """

    image: float
    rotation: float
    translation: float

    @property
    def robot(self) -> Array:
        """The standard deviations of the six residuals of a pose."""
        return np.repeat([self.rotation, self.translation], 3)


class Measured(NamedTuple):
    """The robot's poses at a clock offset, and their derivative with respect to it.

    Attributes
    ----------
    poses : Poses
        base_from_hand (V,).
    velocity : (V, 6) array
        Angular velocity in the base's frame, rad, and velocity, per second.
    """

    poses: Poses
    velocity: Array


#: the robot's poses at an offset, s
Robot = Callable[[float], Measured]


@dataclass(frozen=True)
class Unknowns:
    """The unknowns; the state of the pictures holds the poses of the views."""

    image: State
    x: Pose
    z: Pose
    offset: float = 0.0
    camera: Array = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True)
class Linear:
    """Both parts of the problem, linearised and unweighted.

    Attributes
    ----------
    residual : (V, 6) array
        Of the robot: rotation, rad, and translation.
    by_shared : (V, 6, F) array
        Its derivatives by X, Z (rotation, translation of each), the offset if it is unknown, and the camera.
    by_pose : (V, 6, 6) array
        Its derivatives by the view's pose, in the coordinates of the pictures' problem.
    image : (V, 7, 7) array
        Products of the pictures' rows: pose and residual.
    camera : (K,) array
        z, of variance 1 each before the robot's poses are taken into account; the last columns of `by_shared`.
    """

    residual: Array
    by_shared: Array
    by_pose: Array
    image: Array
    camera: Array


class Joint:
    """The problem (1) for the least-squares loop; a batch of one."""

    count, rounding = 1, 0.0

    def __init__(
        self,
        setup: str,
        pictures: Problem,
        robot: Robot,
        noise: Noise,
        timed: bool = False,
        shifts: Array | None = None,
    ):
        self.setup, self.pictures, self.robot, self.noise, self.timed = setup, pictures, robot, noise, timed
        self.all = np.arange(pictures.instants)
        self.shifts = np.zeros((pictures.instants, 6, 0)) if shifts is None else shifts

    def linear(self, at: Unknowns) -> Linear:
        """Residuals and derivatives; NaN in `image` where a point leaves the lens's domain."""
        c = self.poses(at)
        measured = self.robot(at.offset)
        residual = equation.residuals(self.setup, at.x, at.z, c, measured.poses)
        chain = equation.from_left(residual[:, :3])
        d = equation.derivatives(self.setup, at.x, at.z, c)
        shared = [chain @ d.by_x, chain @ d.by_z]
        if self.timed:
            moved = measured.velocity.copy()
            moved[:, :3] = np.linalg.solve(so3.left_jacobian(-residual[:, :3]), moved[:, :3, None])[..., 0]
            shared.append(-moved[:, :, None])
        by_pose = chain @ d.by_c @ _from_centroid(c, self.pictures.offsets)
        shared.append(by_pose @ self.shifts)
        image = self.pictures.pose_normals(at.image, self.all)
        return Linear(residual, np.concatenate(shared, 2), by_pose, image, at.camera)

    def poses(self, at: Unknowns) -> Poses:
        """cam_from_board (V,) for the estimated camera."""
        c, step = self.pictures.poses(at.image), self.shifts @ at.camera
        centres = c.apply(self.pictures.offsets) + step[:, 3:]
        rotation = so3.exp(step[:, :3]) @ c.rotation
        return Poses(rotation, centres - np.einsum("vij,vj->vi", rotation, self.pictures.offsets))

    def linearise(self, state: Unknowns, members: Array) -> _Equations:
        """The weighted normal equations."""
        return _Equations.of(self.linear(state), self.noise)

    def solve(self, state: Any, equations: _Equations, damping: Array) -> tuple[Any, Array]:
        """The damped step and the decrease that it predicts."""
        step = equations.normal.step(float(damping[0]))
        if step is None:
            return None, np.array([np.nan])
        return step[:2], np.array([step[2]])

    def retract(self, state: Unknowns, step: tuple[Array, Array]) -> Unknowns:
        """exp(δ) R, t + δ of X, Z and all poses."""
        shared, own = step
        image = replace(
            state.image,
            rotations=so3.exp(own[:, :3]) @ state.image.rotations,
            centres=state.image.centres + own[:, 3:],
        )
        offset = state.offset + (float(shared[12]) if self.timed else 0.0)
        camera = state.camera + shared[12 + self.timed :]
        return Unknowns(image, state.x.moved(shared[:6]), state.z.moved(shared[6:12]), offset, camera)

    def tried(self, trial: Trial) -> None:
        """Do nothing: the problem does not learn from trials."""


@dataclass(frozen=True)
class _Equations:
    cost: Array
    normal: BlockNormal

    @classmethod
    def of(cls, linear: Linear, noise: Noise) -> _Equations:
        roots = (1 / noise.robot)[:, None]
        residual, a, j = linear.residual * roots[:, 0], linear.by_shared * roots, linear.by_pose * roots
        image = linear.image / noise.image**2
        cost = 0.5 * (np.square(residual).sum() + image[:, 6, 6].sum() + np.square(linear.camera).sum())
        known, pulled = prior(linear)
        at = np.swapaxes(a, 1, 2)
        jt = np.swapaxes(j, 1, 2)
        normal = BlockNormal(
            float(cost),
            (at @ a).sum(0) + np.diag(known),
            np.einsum("vkf,vk->f", a, residual) + pulled,
            at @ j,
            jt @ j + image[:, :6, :6],
            np.einsum("vkc,vk->vc", j, residual) + image[:, :6, 6],
        )
        return cls(np.array([cost if np.isfinite(cost) else np.inf]), normal)


def prior(linear: Linear) -> tuple[Array, Array]:
    """The prior information (F,) on the shared unknowns without the robot's poses, and the gradient (F,) of ½ |z|²."""
    known, pulled = (np.zeros(linear.by_shared.shape[2]) for _ in range(2))
    begin = len(known) - len(linear.camera)
    known[begin:], pulled[begin:] = 1.0, linear.camera
    return known, pulled


def solve(problem: Joint, start: Unknowns) -> Unknowns:
    """The minimum of (1) near a start."""
    return minimise(problem, start, Options(tolerance=1e-12)).state


def _from_centroid(c: Poses, offsets: Array) -> Array:
    """d pose with respect to (rotation about the centroid of the view's points, its position), (V, 6, 6): dt = dc
    + [R x̄]× δ.
    """
    out = np.broadcast_to(np.eye(6), (len(c), 6, 6)).copy()
    out[:, 3:, :3] = so3.skew(np.einsum("vij,vj->vi", c.rotation, offsets))
    return out
