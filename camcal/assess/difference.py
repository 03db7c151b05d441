"""The difference in projection between two cameras over the image, after the best-fitting rotation.

Different parameter values can describe the same camera, so that cameras are compared by their projections (mrcal's
differencing). A grid of pixels is unprojected with camera A; the rays are turned by the rotation that fits
best and projected with camera B:

    d_i = project_B(R unproject_A(u_i)) - u_i,     R = argmin Σ w_i |d_i|²                               (1)

The rotation is needed because a calibration does not define the camera's frame absolutely: a shifted principal
point and a rotated frame are nearly equivalent. At a finite distance D the points are D unproject_A(u_i), and a
translation is fitted along with the rotation. Where the cameras' uncertainties are known, the weights are
their inverse squares, so that a corner for which neither has data does not dominate the rotation. Pixels outside the
domain of either camera are counted.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from camcal.geometry import rotations
from camcal.least_squares import Normal, Options, Small, minimise
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from camcal.records import dataclass

Array = np.ndarray

#: Of the cost, and steps at most: differences then hold five digits, and those of nearly equal cameras, whose cost has
#: no more digits, end after 2 to 4 steps from the closed-form start.
_TOLERANCE, _STEPS = 1e-10, 30
#: px; penalty of a point outside the camera's domain in each coordinate, so that losing points is no advantage
OUTSIDE = 1e3
#: Columns of the grid over the image.
COLUMNS = 40
#: px; least side for which cells are square: over a picture one pixel wide, whose pixel centres have no distance, they
#: would be without number
LEAST_SIDE = 1.0
#: pixels seen by both cameras that determine a rotation between them, with one to spare
LEAST_PIXELS = 3


@dataclass(frozen=True)
class Difference:
    """The residuals of (1).

    Attributes
    ----------
    pixels : (N, 2) array
        The grid, px.
    vectors : (N, 2) array
        d_i, px; NaN where a pixel lies outside the domain of either camera.
    b_from_a : Pose
        The transformation between the cameras' frames that fits best; translation 0 at infinity.
    """

    pixels: Array
    vectors: Array
    b_from_a: Pose

    @property
    def lengths(self) -> Array:
        """|d_i| (N,), px."""
        return np.linalg.norm(self.vectors, axis=1)

    @property
    def outside(self) -> int:
        """The number of pixels without a difference because a camera does not see them."""
        return int(np.isnan(self.vectors).any(1).sum())

    @property
    def max_px(self) -> float:
        """The largest |d_i|; NaN where no pixel is in both domains."""
        found = self.lengths[~np.isnan(self.lengths)]
        return float(found.max()) if len(found) else float("nan")

    @property
    def rms_px(self) -> float:
        """sqrt(Σ|d_i|² / N) over the pixels in both domains."""
        found = self.lengths[~np.isnan(self.lengths)]
        return float(np.sqrt(np.mean(found**2))) if len(found) else float("nan")

    @property
    def worst(self) -> tuple[float, float] | None:
        """The pixel with the largest difference."""
        if np.isnan(self.lengths).all():
            return None
        u, v = self.pixels[np.nanargmax(self.lengths)].tolist()
        return u, v


def image_grid(low: Array, high: Array, columns: int = COLUMNS) -> Array:
    """Pixels (N, 2) of a regular grid from corner `low` to corner `high` (both (2,), included), px."""
    size = np.maximum(np.subtract(high, low), LEAST_SIDE)
    rows = max(2, round(columns * size[1] / size[0]))
    u, v = np.meshgrid(np.linspace(low[0], high[0], columns), np.linspace(low[1], high[1], rows))
    return np.c_[u.ravel(), v.ravel()]


def grid_of(image_size: tuple[int, int], columns: int = COLUMNS) -> Array:
    """The grid over a picture of (width, height), its outermost pixel centres included."""
    return image_grid(np.zeros(2), np.subtract(image_size, 1.0), columns)


def difference(
    a: Camera,
    b: Camera,
    pixels: Array | None = None,
    distance: float | None = None,
    weights: Array | None = None,
) -> Difference:
    """Compare what two cameras project, equation (1).

    Parameters
    ----------
    a, b : Camera
    pixels : (N, 2) array, optional
        Where; the default is a grid over the image of `a`, else of `b`.
    distance : float, optional
        Of the points, in any unit; the default is infinity, where only a rotation is fitted.
    weights : (N,) array, optional
        w_i of the pixels; all alike by default.

    Raises
    ------
    ValueError
        If no pixels are given and neither camera knows its image size.
    """
    if pixels is None:
        size = a.image_size or b.image_size
        if size is None:
            raise ValueError("neither camera has an image size; pass the pixels")
        pixels = grid_of(size)
    rays, seen_a = a.lens.unproject(a.params, pixels)
    rays_b, seen_b = b.lens.unproject(b.params, pixels)
    seen = seen_a & seen_b
    vectors = np.full(pixels.shape, np.nan)
    root = np.ones(len(pixels)) if weights is None else np.sqrt(weights / np.nanmax(weights))
    fitted = seen & (root > 0)
    if fitted.sum() < LEAST_PIXELS:
        return Difference(pixels, vectors, Pose(np.eye(3), np.zeros(3)))
    points = rays * (1.0 if distance is None else distance)
    begin = rotations.fit_rotation(rays_b[fitted], rays[fitted], root[fitted] ** 2)
    problem = _Alignment(b, points[fitted], pixels[fitted], root[fitted], distance is not None)
    found = minimise(problem, _Placed(begin[None], np.zeros((1, 3))), Options(_TOLERANCE, _STEPS)).state
    pose = Pose(found.rotations[0], found.translations[0])
    points = points[seen]
    vectors[seen] = b.project(pose.apply(points)) - pixels[seen]
    return Difference(pixels, vectors, pose)


class _Placed(NamedTuple):
    """A rotation (1, 3, 3) and a translation (1, 3)."""

    rotations: Array
    translations: Array


class _Alignment(Small):
    """(1) as the one member of a batch of `least_squares`: the pose of points before a camera."""

    count = 1

    def __init__(self, camera: Camera, points: Array, pixels: Array, root: Array, with_translation: bool):
        self.camera, self.points, self.pixels, self.root = camera, points, pixels, root
        self.unknowns = 6 if with_translation else 3
        # a few units in the last place of each coordinate
        self.rounding = len(pixels) * (4 * np.finfo(float).eps * float(np.abs(pixels).max())) ** 2

    def linearise(self, state: _Placed, members: Array) -> Normal:
        """Residuals in px, times the roots of the weights."""
        turned = self.points @ state.rotations[0].T
        uv, d_xyz, _, valid = self.camera.lens.jacobians(self.camera.params, turned + state.translations[0])
        j = np.concatenate([-d_xyz @ rotations.skew(turned), d_xyz], 2)[:, :, : self.unknowns]
        r = np.where(valid[:, None], uv - self.pixels, OUTSIDE)
        j = np.where(valid[:, None, None], j, 0.0)
        r, j = r * self.root[:, None], j * self.root[:, None, None]
        return Normal.of(r.reshape(1, -1), j.reshape(1, -1, self.unknowns).transpose(0, 2, 1))

    def retract(self, state: _Placed, step: Array) -> _Placed:
        """exp(δ) R, t + δ."""
        shift = step[:, 3:] if self.unknowns == 6 else 0.0
        return _Placed(rotations.exp(step[:, :3]) @ state.rotations, state.translations + shift)
