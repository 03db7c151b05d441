"""Selection of poses that agree with one another even if several outliers mask each other."""

from __future__ import annotations

import numpy as np

from camcal.least_squares.distributions import chi2_quantile
from camcal.model.pose import Array
from camcal.routes.hand_eye import equation, shah
from camcal.routes.hand_eye.views import Views, from_rotations

#: Poses of a sample: one more than are needed, to reduce the effect of noise. With a third of the poses wrong, one
#: sample in five is free of them, and all of SAMPLES contain one with probability 2e-15.
SAMPLE = 4
SAMPLES = 150
#: Fewer poses are only tested one by one: their median is unreliable.
LEAST = 8
#: Robust standard deviations above which a pose is excluded from the start; it is used later if it fits.
FAR = 6.0
ROUNDING = 1e-12  #: rad, and units of the robot's lengths: lower limit of the scale, for exact poses


def agreeing(views: Views, setup: str, seed: int = 0) -> Array:
    """Mask (V,) of the poses that agree with the transformation of least median residual (Rousseeuw 1984)."""
    count = len(views)
    if count < LEAST:
        return np.ones(count, bool)
    rng = np.random.default_rng(seed)
    measured = views.robot_poses(setup)
    rows = np.stack([rng.choice(count, SAMPLE, replace=False) for _ in range(SAMPLES)])
    robot, camera = views.robot.rotation[rows], views.camera.rotation[rows]
    of_x, of_z = shah.rotations_of(robot, camera)
    places = views.robot.translation[rows], views.camera.translation[rows]
    x, z = from_rotations(robot, *places, of_x, of_z)
    off = equation.residuals(setup, x, z, views.camera, measured)  # (SAMPLES, V, 6)
    sizes = np.stack([np.linalg.norm(off[..., :3], axis=-1), np.linalg.norm(off[..., 3:], axis=-1)])
    scores = np.log(np.median(sizes, axis=2) + np.finfo(float).tiny).sum(0)
    best = sizes[:, np.argmin(np.where(np.isfinite(scores), scores, np.inf))]
    # the norm of three standard normal variables has the median 1.54
    unit = np.median(best, axis=1, keepdims=True) / np.sqrt(chi2_quantile(0.5, 3))
    return np.asarray((best <= FAR * np.maximum(unit, ROUNDING)).all(0))
