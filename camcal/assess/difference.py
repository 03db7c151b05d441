"""How differently two cameras project: over the image, after the best-fitting rotation.

Parameters of different values can mean the same camera, so cameras are compared by what they do (mrcal's
differencing). A grid of pixels is unprojected with camera A; the rays are turned by the rotation that fits
best and projected with camera B:

    d_i = project_B(R unproject_A(u_i)) - u_i,     R = argmin Σ w_i |d_i|²                               (1)

The rotation is there because a calibration does not tie the camera's frame to anything: a shifted principal
point and a turned frame are nearly the same. At a finite distance D the points are D unproject_A(u_i), and a
translation is fitted along with the rotation. Where the cameras' uncertainties are known, weights of one over
their squares keep a corner that neither knows from turning the whole. Pixels outside the domain of either
camera are counted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camcal.geometry import rotations
from camcal.model.camera import Camera
from camcal.model.pose import Pose

Array = np.ndarray

#: Gauss-Newton on 3 or 6 unknowns from a closed-form start; near-equal cameras take 2 to 4 steps.
_STEPS = 30
#: Columns of the grid over the image.
COLUMNS = 40


@dataclass(frozen=True)
class Difference:
    """What (1) leaves.

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
        """How many pixels have no difference because a camera does not see them."""
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
    size = np.maximum(np.subtract(high, low), 1e-9)
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
        Where no pixels are given and neither camera knows its image size.
    """
    if pixels is None:
        size = a.image_size or b.image_size
        if size is None:
            raise ValueError("neither camera knows its image size; give the pixels")
        pixels = grid_of(size)
    rays, seen_a = a.lens.unproject(a.params, pixels)
    rays_b, seen_b = b.lens.unproject(b.params, pixels)
    seen = seen_a & seen_b
    vectors = np.full(pixels.shape, np.nan)
    root = np.ones(len(pixels)) if weights is None else np.sqrt(weights / np.nanmax(weights))
    fitted = seen & (root > 0)
    if fitted.sum() < 3:
        return Difference(pixels, vectors, Pose(np.eye(3), np.zeros(3)))
    points = rays * (1.0 if distance is None else distance)
    begin = Pose(rotations.fit_rotation(rays_b[fitted], rays[fitted], root[fitted] ** 2), np.zeros(3))
    pose = _fit(b, points[fitted], pixels[fitted], root[fitted], begin, distance is not None)
    points = points[seen]
    vectors[seen] = b.project(pose.apply(points)) - pixels[seen]
    return Difference(pixels, vectors, pose)


def _fit(
    camera: Camera, points: Array, pixels: Array, root: Array, pose: Pose, with_translation: bool
) -> Pose:
    """The pose that minimises Σ w |project(R x + t) - u|² by Gauss-Newton, halving steps that do not help.

    `root` are the square roots of the weights.
    """
    cost, step = _cost(camera, points, pixels, root, pose), None
    for _ in range(_STEPS):
        step = _step(camera, points, pixels, root, pose, with_translation)
        for _ in range(8):
            trial = Pose(rotations.exp(step[:3]) @ pose.rotation, pose.translation + step[3:])
            trial_cost = _cost(camera, points, pixels, root, trial)
            if trial_cost < cost:
                break
            step = step / 2
        else:
            return pose
        gained, pose, cost = cost - trial_cost, trial, trial_cost
        if gained <= 1e-12 * cost:
            break
    return pose


def _cost(camera: Camera, points: Array, pixels: Array, root: Array, pose: Pose) -> float:
    # a point that leaves the domain costs a lot instead of nothing
    r = camera.project(pose.apply(points)) - pixels
    r = (np.where(np.isnan(r), 1e3, r) * root[:, None]).ravel()
    return float(r @ r)


def _step(
    camera: Camera, points: Array, pixels: Array, root: Array, pose: Pose, with_translation: bool
) -> Array:
    cam = pose.apply(points)
    uv, d_xyz, _, valid = camera.lens.jacobians(camera.params, cam)
    turn = -d_xyz @ rotations.skew(points @ pose.rotation.T)
    jacobian = np.concatenate([turn, d_xyz], 2) if with_translation else turn
    jacobian, r = jacobian * root[:, None, None], (uv - pixels) * root[:, None]
    j = jacobian[valid].reshape(-1, jacobian.shape[2])
    step = np.linalg.lstsq(j, -r[valid].ravel(), rcond=None)[0]
    return np.r_[step, np.zeros(6 - len(step))]
