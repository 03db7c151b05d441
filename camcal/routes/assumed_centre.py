"""A principal point, or centre of distortion, that the data leave undetermined: the image centre is assumed.

The rule of all routes without known points: it is freed where its standard deviation is small enough, and otherwise
held; the other standard deviations contain the uncertainty of the assumption.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from camcal.model.camera import Camera
from camcal.model.pose import Array

#: Principal points of real cameras lie within this fraction of the picture's longer side from its middle, which is
#: therefore a better estimate than one with a larger standard deviation.
CENTRE = 0.05
#: standard deviations of an assumed coordinate within which its effect on the others is linear
LINEAR = 0.5
#: names of the coordinates: of the principal point, px, and of models with their own centre, in focal lengths
PIXELS, FOCAL_LENGTHS = ("cx", "cy"), ("xc", "yc")


def undetermined(camera: Camera, sigmas: Array, names: Sequence[str]) -> tuple[str, ...]:
    """Those of the coordinates `names` whose standard deviations, of `sigmas` (P,), are too large."""
    bound = CENTRE * _longer(camera)
    at = camera.lens.names.index
    return tuple(n for n in names if not sigmas[at(n)] * px_per_unit(camera, n) <= bound)


def doubt(camera: Camera, assumed: Sequence[str], refitted: Callable[[Camera, str], Array | None]) -> Array:
    """The covariance (P, P) of the other parameters due to the uncertainty of the assumed ones: `CENTRE`, one sigma.

    `refitted` gives the parameters (P,) that fit a camera with that coordinate moved; None if none do.
    """
    index = [camera.lens.names.index(n) for n in assumed]
    covariance = np.zeros((len(camera.params), len(camera.params)))
    for name in assumed:
        found = refitted(moved(camera, name), name)
        if found is not None:
            slope = (found - camera.params) / LINEAR
            slope[index] = 0
            covariance += np.outer(slope, slope)
    return covariance


def moved(camera: Camera, name: str) -> Camera:
    """The camera with an assumed coordinate moved by `LINEAR` standard deviations of it."""
    params = camera.params.copy()
    at = camera.lens.names.index(name)
    params[at] += LINEAR * CENTRE * _longer(camera) / px_per_unit(camera, name)
    return replace(camera, params=params)


def px_per_unit(camera: Camera, name: str) -> float:
    """The number of px per unit of a coordinate."""
    focal = dict(zip(FOCAL_LENGTHS, camera.params[:2].tolist(), strict=True))
    return float(focal.get(name, 1.0))


def _longer(camera: Camera) -> float:
    assert camera.image_size is not None
    return float(max(camera.image_size))
