"""The closest camera of another model, over the whole image."""

from __future__ import annotations

import numpy as np

from camcal.errors import EstimationError, UsageError
from camcal.model.camera import Camera
from camcal.model.lenses.base import Lens
from camcal.model.lenses.regress import Regression, regress
from camcal.records import dataclass

Array = np.ndarray

#: pixels with a ray that a conversion needs: as many as determine a camera matrix with five coefficients, with some to
#: spare
LEAST_PIXELS = 12
#: columns and rows of pixels over which cameras are matched, the outermost ones on the image's border: 1271, twice
#: what a model of 600 coefficients needs
GRID = (41, 31)


@dataclass(frozen=True)
class Conversion:
    """A camera of another model and its distance from the original.

    Attributes
    ----------
    camera : Camera
    pixels : (N, 2) array
        Where the two were compared: pixels of a grid over the image that have a ray.
    errors : (N,) array
        Distances in px; NaN where the other model holds no such ray.
    without_ray : float
        Part of the grid outside the first camera's domain.
    """

    camera: Camera
    pixels: Array
    errors: Array
    without_ray: float

    @property
    def max_px(self) -> float:
        """The largest distance; inf if the new model does not cover every pixel."""
        return float(self.errors.max()) if np.isfinite(self.errors).all() else np.inf

    @property
    def rms_px(self) -> float:
        """Root mean square distance over the pixels that the new model covers."""
        found = self.errors[np.isfinite(self.errors)]
        return float(np.sqrt(np.mean(found**2))) if len(found) else np.inf

    @property
    def reached(self) -> float:
        """The fraction of the pixels that the new model covers."""
        return float(np.isfinite(self.errors).mean())


def convert(camera: Camera, lens: Lens, square: bool = False) -> Conversion:
    """The camera of the model `lens` that is closest in px, in the same frame, over the whole image.

    `square` asks for one focal length, fx = fy.

    Raises
    ------
    UsageError
        If the camera does not know its image size.
    EstimationError
        If no pixel of it has a ray.
    """
    if camera.image_size is None:
        raise UsageError("the camera file has no image size.", "Give --image-size WxH.")
    width, height = camera.image_size
    u, v = np.meshgrid(np.linspace(0, width - 1, GRID[0]), np.linspace(0, height - 1, GRID[1]))
    pixels = np.c_[u.ravel(), v.ravel()]
    rays, valid = camera.lens.unproject(camera.params, pixels)
    if valid.sum() < LEAST_PIXELS:
        raise EstimationError(
            f"only {valid.sum()} of {len(pixels)} pixels of the camera's image have a ray; at least {LEAST_PIXELS} are "
            "needed.",
            "Check the camera's file: its parameters and its image size.",
        )
    hold = [n for n in lens.default_fixed if n not in lens.turns]
    found: Regression = regress(lens, rays[valid], pixels[valid], camera.image_size, hold)
    if square:
        found = _one_focal_length(lens, rays[valid], pixels[valid], camera.image_size, hold, found)
    return Conversion(
        Camera(lens, found.params, camera.image_size),
        pixels[valid],
        found.errors,
        float(1 - valid.mean()),
    )


#: relative steps of the focal length about which a parabola is laid through the squared error: the first is the
#: difference between fx and fy of ordinary cameras; with smaller last ones rounding decides
STEPS = (1e-2, 1e-3, 1e-3)


def _one_focal_length(
    lens: Lens, rays: Array, pixels: Array, size: tuple[int, int], hold: list[str], free: Regression
) -> Regression:
    """The closest camera with fx = fy; the squared error is nearly a parabola in the focal length."""
    held, x, y = [*hold, "fx", "fy"], lens.index("fx"), lens.index("fy")

    def at(f: float) -> Regression:
        start = free.params.copy()
        start[x] = start[y] = f
        return regress(lens, rays, pixels, size, held, start)

    def cost(found: Regression) -> float:
        return float(np.nanmean(found.errors**2))

    best = at(float(free.params[[x, y]].mean()))
    for step in STEPS:
        f = float(best.params[x])
        below, above = at(f * (1 - step)), at(f * (1 + step))
        a, b, c = cost(below), cost(best), cost(above)
        if a + c > 2 * b:
            moved = at(f * (1 + 0.5 * step * (a - c) / (a + c - 2 * b)))
            best = min((below, best, above, moved), key=cost)
    return best
