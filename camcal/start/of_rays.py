"""A camera with a tabulated lens model, fitted to the rays of a closed form."""

from __future__ import annotations

import numpy as np

from camcal.model.camera import Camera
from camcal.model.lenses import make
from camcal.model.lenses.regress import regress

Array = np.ndarray

#: even powers to R⁶, rays to 90 degrees and beyond
MODEL = "division:3"


def camera_of(rays: Array, uv: Array, image_size: tuple[int, int] | None) -> Camera:
    """The camera of the division model with three terms nearest to rays (N, 3) of any length, at pixels (N, 2)."""
    unit = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    return Camera(make(MODEL), regress(make(MODEL), unit, uv, image_size).params, image_size)
