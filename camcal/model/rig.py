"""Cameras that are rigidly mounted together."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from camcal.errors import UsageError
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from camcal.records import dataclass

Array = np.ndarray

#: largest entry of RᵀR - I: poses read from files have about seven digits, and products of ten such matrices
#: stay below this; a matrix with a scale or a transposed entry is off by far more
ROTATION_TOLERANCE = 1e-5


@dataclass(frozen=True, eq=False, repr=False)
class Rig:
    """Cameras by name, with their poses in the frame of the rig.

    Attributes
    ----------
    cameras : mapping of name -> Camera
    cam_from_rig : mapping of name -> Pose
        One for each camera; that of the reference may be left out, or is the identity.
    reference : str
        The camera whose frame is the frame of the rig.

    Raises
    ------
    UsageError
        If names are missing or unknown, or a pose is not a rigid transformation.
    """

    cameras: Mapping[str, Camera]
    cam_from_rig: Mapping[str, Pose]
    reference: str

    def __post_init__(self) -> None:
        cameras, poses = dict(self.cameras), dict(self.cam_from_rig)
        if self.reference not in cameras:
            raise UsageError(
                f"the reference camera '{self.reference}' is not among the cameras of the rig.",
                "It has: " + (", ".join(cameras) or "none") + ".",
            )
        poses.setdefault(self.reference, Pose.identity())
        for name in poses:
            if name not in cameras:
                raise UsageError(f"the rig has a pose of '{name}', but no such camera.")
        for name in cameras:
            if name not in poses:
                raise UsageError(f"the rig has no pose of the camera '{name}'.", "Give cam_from_rig for it.")
            _check_rigid(name, poses[name])
        own = poses[self.reference].matrix
        if np.abs(own - np.eye(4)).max() > ROTATION_TOLERANCE:
            raise UsageError(
                f"the pose of the reference camera '{self.reference}' is not the identity.",
                "Use Rig.in_frame_of, which moves the frame of the rig to that camera.",
            )
        object.__setattr__(self, "cameras", MappingProxyType(cameras))
        object.__setattr__(self, "cam_from_rig", MappingProxyType({n: poses[n] for n in cameras}))

    @staticmethod
    def in_frame_of(reference: str, cameras: Mapping[str, Camera], cam_from_world: Mapping[str, Pose]) -> Rig:
        """A rig from the poses of all its cameras in any common frame."""
        if reference not in cam_from_world:
            raise UsageError(f"there is no pose of the reference camera '{reference}'.")
        world_from_rig = cam_from_world[reference].inverse()
        moved = {n: p @ world_from_rig for n, p in cam_from_world.items() if n != reference}
        return Rig(cameras, moved, reference)

    def with_reference(self, name: str) -> Rig:
        """The same rig in the frame of another of its cameras."""
        return Rig.in_frame_of(name, self.cameras, self.cam_from_rig)

    def relative(self, to: str, source: str) -> Pose:
        """The transformation to_from_source between two cameras."""
        return self.cam_from_rig[to] @ self.cam_from_rig[source].inverse()

    def baseline(self, a: str, b: str) -> float:
        """The distance between the centres of two cameras, in the unit of the poses."""
        return float(np.linalg.norm(self.relative(a, b).translation))

    def project(self, xyz_rig: Array) -> dict[str, Array]:
        """Pixels (..., 2) of points (..., 3) of the rig's frame, by camera; NaN outside a lens's domain."""
        return {n: c.project(self.cam_from_rig[n].apply(xyz_rig)) for n, c in self.cameras.items()}

    def __repr__(self) -> str:
        """Return one line: the cameras and their models."""
        models = ", ".join(f"{name}: {c.lens.name}" for name, c in self.cameras.items())
        return f"<Rig {models}; reference {self.reference}>"


def _check_rigid(name: str, pose: Pose) -> None:
    r, t = np.asarray(pose.rotation), np.asarray(pose.translation)
    if r.shape != (3, 3) or t.shape != (3,):
        raise UsageError(
            f"the pose of the camera '{name}' is not a single rotation (3, 3) and translation (3,)."
        )
    off = np.abs(r.T @ r - np.eye(3)).max()
    if not (off <= ROTATION_TOLERANCE and np.linalg.det(r) > 0 and np.isfinite(t).all()):
        raise UsageError(
            f"the pose of the camera '{name}' is not a rigid transformation (RᵀR - I reaches {off:.2g}, "
            f"det R = {np.linalg.det(r):.3g}).",
            "R must be orthonormal with determinant 1; t must be finite.",
        )
