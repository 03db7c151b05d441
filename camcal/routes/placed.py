"""Cameras with their poses in the world."""

from __future__ import annotations

import numpy as np

from camcal.geometry import projective
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Array, Pose
from camcal.records import dataclass


@dataclass(frozen=True)
class PlacedCamera:
    """A camera and cam_from_world; the rotation may be improper if the world's frame is left-handed."""

    name: str
    camera: Camera
    pose: Pose

    @classmethod
    def of_matrix(cls, name: str, matrix: Array) -> PlacedCamera:
        """The camera of a projection matrix (3, 4), with the handedness for which depths are positive if m34 > 0."""
        k, rotation, translation, _ = projective.decompose(matrix)
        lens = lenses.make("pinhole", skew=True)
        return cls(name, Camera(lens, lens.from_matrix(k)), Pose(rotation, translation))

    def mirrored(self) -> PlacedCamera:
        """The same projection with the other side of the camera in front."""
        return PlacedCamera(self.name, self.camera, Pose(-self.pose.rotation, -self.pose.translation))

    @property
    def centre(self) -> Array:
        """The centre of projection (3,) in the world."""
        return self.pose.centre

    @property
    def matrix(self) -> Array:
        """The projection matrix (3, 4), without the distortion."""
        return projective.compose(self.camera.matrix, self.pose.rotation, self.pose.translation)

    def rays(self, uv: Array) -> Array:
        """Directions (N, 3) of unit length in the world, NaN outside the lens's domain."""
        return self.camera.unproject(uv) @ self.pose.rotation

    def residuals(self, xyz: Array, uv: Array) -> tuple[Array, Array]:
        """Predicted - observed (N, 2), px, and its Jacobian (N, 2, 3) by the points; NaN outside the domain."""
        projected, d_xyz, _, _ = self.camera.lens.jacobians(self.camera.params, self.pose.apply(xyz))
        return projected - uv, d_xyz @ self.pose.rotation

    def project(self, xyz: Array) -> Array:
        """Images (N, 2) of points of the world, px; NaN outside the domain."""
        return self.camera.project(self.pose.apply(np.asarray(xyz, float)))
