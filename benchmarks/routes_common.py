"""Made scenes for each route, their truth, and the Cramér-Rao bound of the figure that is looked at.

A case is fixed but for the noise: `observe(theta)` gives all image coordinates (or first-order distances from lines)
of parameters theta, of which the first is the figure looked at; what else is unknown (poses, points, lines) stands
behind it. The bound is the root of the first entry of (JᵀJ)⁺ times the noise, J by central differences.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from camcal.errors import EstimationError
from camcal.geometry import rotations
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose

Array = np.ndarray
SIZE = (1280, 960)
MIDDLE = np.array([639.5, 479.5])
F = 1000.0
PINHOLE = Camera(lenses.make("pinhole"), np.array([F, F, *MIDDLE]), SIZE)


@dataclass(frozen=True)
class Case:
    """A scene of a route.

    Attributes
    ----------
    route, scene, figure : str
    truth : float
    bound : float
        The Cramér-Rao bound for noise of 1 px.
    run : (random generator, noise in px) -> (estimate, its sigma or None[, its 95 % interval])
        Raises a CamcalError where the route refuses.
    freedom : float
        Degrees of freedom of the noise that the sigmas are scaled by, where few.
    """

    route: str
    scene: str
    figure: str
    truth: float
    bound: float
    run: Callable[[np.random.Generator, float], tuple]
    freedom: float = np.inf


def bound(observe: Callable[[Array], Array], theta: Array, index: int = 0) -> float:
    """The standard deviation of theta[index] for noise of 1 in every coordinate; inf where it is undetermined."""
    step = 1e-6 * np.maximum(np.abs(theta), 1.0)
    columns = [
        (observe(theta + s * e) - observe(theta - s * e)) / (2 * s)
        for s, e in zip(step, np.eye(len(theta)), strict=True)
    ]
    j = np.stack(columns, 1)
    scale = np.maximum(np.linalg.norm(j, axis=0), 1e-300)
    _, s, vt = np.linalg.svd(j / scale, full_matrices=False)
    known = s > 1e-8 * s[0]  # differences are good to about 1e-9; frame and scale of a world stand below it
    if np.abs(vt[~known, index]).max(initial=0) > 1e-6:
        return float("inf")
    return float(np.sqrt(np.square(vt[known, index] / s[known]).sum()) / scale[index])


def pinhole(cam: Array, f: float = F, centre: Array = MIDDLE, k: float = 0.0) -> Array:
    """Images of points in the camera's frame; k is the division model's coefficient, in focal lengths."""
    r2 = (cam[..., :2] ** 2).sum(-1, keepdims=True)
    # R = r (1 + k R²) / z, solved for the image radius
    z = cam[..., 2:]
    return centre + f * cam[..., :2] * 2 / (z + np.sqrt(z * z - 4 * k * r2))


def looking(position: Array, target: Array, roll: float = 0.0) -> Pose:
    """A camera at a position that looks at a target."""
    z = (target - position) / np.linalg.norm(target - position)
    x = np.cross(z, [0, 0, 1.0])
    x /= np.linalg.norm(x)
    rotation = rotations.exp(np.array([0, 0, roll])) @ np.array([x, np.cross(z, x), z])
    return Pose(rotation, -rotation @ position)


def board(columns: int = 9, rows: int = 6, square: float = 0.03) -> Array:
    """A plane of points about the origin."""
    x, y = np.meshgrid(np.arange(columns) - (columns - 1) / 2, np.arange(rows) - (rows - 1) / 2)
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], 1) * square


def apply(motion: Array, xyz: Array) -> Array:
    """Points after a motion (rotation vector, translation)."""
    return xyz @ rotations.exp(motion[:3]).T + motion[3:]


def undetermined(why: str) -> EstimationError:
    """A route's own word that a figure is undetermined."""
    return EstimationError(why, "")
