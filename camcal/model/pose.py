"""Rigid transformations, x_to = R x_from + t, one or a stack of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

Array = np.ndarray


@dataclass(frozen=True)
class Pose:
    """A rigid transformation, x_to = R x_from + t.

    Attributes
    ----------
    rotation : (3, 3) array
    translation : (3,) array, in the unit of the points
    """

    rotation: Array
    translation: Array

    def apply(self, xyz: Array) -> Array:
        """Transform points (..., 3)."""
        return xyz @ self.rotation.T + self.translation

    def inverse(self) -> Pose:
        """Return the transformation the other way round."""
        return Pose(self.rotation.T, -self.rotation.T @ self.translation)

    def after(self, first: Pose) -> Pose:
        """Return self o first: a_from_b.after(b_from_c) is a_from_c."""
        return Pose(self.rotation @ first.rotation, self.rotation @ first.translation + self.translation)


@dataclass(frozen=True)
class Poses(Sequence):
    """A pose per view, as arrays: `rotations` (V, 3, 3) and `translations` (V, 3)."""

    rotations: Array
    translations: Array

    @classmethod
    def stack(cls, poses: Sequence[Pose]) -> Poses:
        """Collect single poses."""
        if not poses:
            return cls(np.zeros((0, 3, 3)), np.zeros((0, 3)))
        return cls(np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses]))

    def __len__(self) -> int:
        return len(self.rotations)

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, (int, np.integer)):
            return Pose(self.rotations[index], self.translations[index])
        return Poses(self.rotations[index], self.translations[index])

    def __iter__(self) -> Iterator[Pose]:
        return (Pose(r, t) for r, t in zip(self.rotations, self.translations, strict=True))
