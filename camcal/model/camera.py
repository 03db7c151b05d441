"""A lens model with the values of its parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camcal.model.lenses.base import Lens

Array = np.ndarray


@dataclass(frozen=True)
class Camera:
    """A lens model with the values of its parameters.

    Attributes
    ----------
    lens : Lens
        The model, with its options.
    params : (P,) array
        In the order of `lens.names`.
    image_size : (width, height) or None
    """

    lens: Lens
    params: Array
    image_size: tuple[int, int] | None = None

    @property
    def matrix(self) -> Array:
        """The 3x3 matrix [[fx, skew, cx], [0, fy, cy], [0, 0, 1]], px."""
        return self.lens.matrix(self.params)

    @property
    def values(self) -> dict[str, float]:
        """The parameters by name."""
        return dict(zip(self.lens.names, self.params.tolist(), strict=True))

    def project(self, xyz_cam: Array) -> Array:
        """Project points (..., 3) of the camera's frame to pixels (..., 2); NaN outside the lens's domain."""
        return self.lens.project(self.params, xyz_cam)[0]

    def unproject(self, uv: Array) -> Array:
        """Rays of unit length (..., 3) of the pixels (..., 2); NaN outside the lens's domain."""
        return self.lens.unproject(self.params, uv)[0]
