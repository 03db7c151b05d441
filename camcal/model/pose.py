"""Rigid transformations, x_to = R x_from + t, one or an array of them.

Names compose by cancelling: `a_from_b @ b_from_c` is a_from_c. Batch axes broadcast as in numpy.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from camcal.geometry import rotations as so3
from camcal.records import dataclass

Array = np.ndarray


@dataclass(frozen=True, eq=False, repr=False)
class Pose:
    """A rigid transformation, x_to = R x_from + t.

    Attributes
    ----------
    rotation : (..., 3, 3) array
    translation : (..., 3) array, in the unit of the points
    """

    rotation: Array
    translation: Array

    @classmethod
    def identity(cls) -> Pose:
        """The identity transformation."""
        return Pose(np.eye(3), np.zeros(3))

    @staticmethod
    def from_vector(rotation_vector: Array, translation: Array) -> Pose:
        """From rotation vectors (..., 3), rad, and translations (..., 3); a `Poses` for several."""
        return _made(so3.exp(rotation_vector), np.asarray(translation, float))

    @staticmethod
    def from_entry(entry: Mapping[str, Any]) -> Pose:
        """From the entry of a file; the inverse of `entry`."""
        return Pose.from_vector(*(np.array(entry[k], float) for k in ("rotation_vector", "translation")))

    def entry(self) -> dict[str, list[float]]:
        """The form in files: `rotation_vector`, rad, and `translation`."""
        return {"rotation_vector": self.rotation_vector.tolist(), "translation": self.translation.tolist()}

    def moved(self, step: Array) -> Pose:
        """exp(δ) R, t + τ after a step (δ, τ) (6,): the variables in which poses are estimated."""
        return Pose(so3.exp(step[:3]) @ self.rotation, self.translation + step[3:])

    def step_to(self, other: Pose) -> Array:
        """The step (6,) by which `moved` reaches another pose."""
        return np.r_[so3.log(other.rotation @ self.rotation.T), other.translation - self.translation]

    @property
    def rotation_vector(self) -> Array:
        """The rotation vector (..., 3): the axis times the angle, 0 to π rad."""
        return so3.log(self.rotation)

    @property
    def centre(self) -> Array:
        """The origin of the frame `to` in the other frame (..., 3): for cam_from_world, the camera's centre."""
        return -_turned(np.swapaxes(self.rotation, -1, -2), self.translation)

    @property
    def matrix(self) -> Array:
        """The homogeneous matrix (..., 4, 4) [R t; 0 1]."""
        out = np.zeros((*self.shape, 4, 4))
        out[..., :3, :3], out[..., :3, 3], out[..., 3, 3] = self.rotation, self.translation, 1.0
        return out

    @property
    def shape(self) -> tuple[int, ...]:
        """The batch axes: () for a single pose."""
        return np.broadcast_shapes(self.rotation.shape[:-2], self.translation.shape[:-1])

    def apply(self, xyz: Array) -> Array:
        """Transform points.

        A single pose takes points (..., 3). Of several, the batch axes broadcast with the leading axes of the
        points: `poses[:, None].apply(xyz)` takes points (N, 3) to (V, N, 3), each of them by each pose.
        """
        if self.rotation.ndim == 2:
            return xyz @ self.rotation.T + self.translation
        return _turned(self.rotation, np.asarray(xyz)) + self.translation

    def inverse(self) -> Pose:
        """The inverse transformation."""
        return _made(np.swapaxes(self.rotation, -1, -2), self.centre)

    def __matmul__(self, first: Pose) -> Pose:
        """`a_from_b @ b_from_c` = a_from_c."""
        turned = _turned(self.rotation, first.translation)
        return _made(self.rotation @ first.rotation, turned + self.translation)

    def __repr__(self) -> str:
        """Return one line: the rotation angle and the translation."""
        if self.shape:
            return f"<Poses {' x '.join(map(str, self.shape))}>"
        angle = np.degrees(np.linalg.norm(self.rotation_vector))
        x, y, z = self.translation.tolist()
        return f"<Pose {angle:.4g} deg, translation ({x:.5g}, {y:.5g}, {z:.5g})>"


class Poses(Pose, Sequence):
    """Poses with batch axes (V, ...), one per view: a sequence of them along the first axis."""

    @classmethod
    def stack(cls, poses: Sequence[Pose]) -> Poses:
        """Collect poses of equal shape along a new first axis."""
        if not poses:
            return cls(np.zeros((0, 3, 3)), np.zeros((0, 3)))
        return cls(np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses]))

    @classmethod
    def of(cls, pose: Pose) -> Poses:
        """Make a sequence of a pose with batch axes, such as a product of poses."""
        return cls(pose.rotation, pose.translation)

    @property
    def rotations(self) -> Array:
        """The rotations (V, 3, 3)."""
        return self.rotation

    @property
    def translations(self) -> Array:
        """The translations (V, 3)."""
        return self.translation

    def __len__(self) -> int:
        return len(self.rotation)

    def __getitem__(self, index: Any) -> Any:
        """Index the batch axes as those of an array: a `Pose` if none is left."""
        full = (*index, Ellipsis) if isinstance(index, tuple) else (index, Ellipsis)
        return _made(self.rotation[(*full, slice(None), slice(None))], self.translation[(*full, slice(None))])

    def __iter__(self) -> Iterator[Any]:
        return (_made(r, t) for r, t in zip(self.rotation, self.translation, strict=True))


def _made(rotation: Array, translation: Array) -> Any:
    return (Poses if rotation.ndim > 2 or translation.ndim > 1 else Pose)(rotation, translation)


def _turned(rotation: Array, xyz: Array) -> Array:
    """R x for rotations (..., 3, 3) and vectors (..., 3)."""
    return np.asarray((rotation @ xyz[..., None])[..., 0])
