"""Poses that agree with one another, where several outliers mask each other."""

from __future__ import annotations

import numpy as np
from scipy import stats

from camcal.model.pose import Array
from camcal.routes.hand_eye import equation, shah
from camcal.routes.hand_eye.views import Views, from_rotations

#: Poses of a sample: one more than are needed, so that noise counts less. With a third of the poses wrong, one sample
#: in five is without them, and all of SAMPLES have one with the probability 2e-15.
SAMPLE = 4
SAMPLES = 150
#: Fewer poses are only tested one by one: their median is unreliable.
LEAST = 8
#: Robust standard deviations from which on a pose is left out of the start; it is used later if it fits.
FAR = 6.0
ROUNDING = 1e-12  #: rad, and units of the robot's lengths: a residual of exact poses is not compared with 0


def agreeing(views: Views, setup: str, seed: int = 0) -> Array:
    """The poses (V,), bool, that agree with the transformation of the least median residual (Rousseeuw 1984)."""
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
    # the length of three numbers of standard deviation 1 has the median 1.54
    unit = np.median(best, axis=1, keepdims=True) / np.sqrt(stats.chi2.median(3))
    return np.asarray((best <= FAR * np.maximum(unit, ROUNDING)).all(0))
