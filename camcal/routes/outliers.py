"""The points that agree on a pose: samples of three, least median of squares, then individual tests."""

from __future__ import annotations

import numpy as np

from camcal.data.observations import View
from camcal.least_squares.distributions import f_bound
from camcal.least_squares.scales import of_small_sample
from camcal.model.camera import Camera
from camcal.model.pose import Array, Pose
from camcal.routes.pose_fit import refine_pose
from camcal.solve import p3p

#: below this many points outliers are not searched: with four wrong ones among eight, eight points still
#: leave the correct pose two degrees of freedom
LEAST = 8
#: samples of three: with half of the points wrong, one of 130 is free of them in all but 3 of 1e8 cases
SAMPLES = 130
#: points on which the samples are scored
SCORED = 400
#: a correct point is rejected in one view of a hundred
LEVEL = 0.01
ROUNDING = 1e-18  #: px²; lower limit of the noise: rounding of coordinates of 1e4 px
ROUNDS = 10  #: largest number of rounds of testing and refitting


def consensus(camera: Camera, view: View, rays: Array, seed: int = 0) -> Array:
    """The points (N,) that agree on one pose.

    The pose of the least median of squared residuals (Rousseeuw, Least median of squares regression, 1984)
    gives an initial scale. Then points are included or excluded by comparing their residuals with the scale of the
    included ones, by an F test with (2, 2m - 6) degrees of freedom at `LEVEL` over all points (Bonferroni), until the
    selection is stable.
    """
    count = len(view)
    everybody = np.ones(count, bool)
    if count < LEAST:
        return everybody
    rng = np.random.default_rng(seed)
    triples = np.stack([rng.choice(count, 3, replace=False) for _ in range(SAMPLES)])
    found = p3p.poses(view.xyz[triples], rays[triples]).reshape(-1, 3, 4)
    found = found[np.isfinite(found).all((1, 2))]
    if not len(found):
        return everybody
    sigma = np.ones(count) if view.sigma is None else view.sigma
    scored = rng.choice(count, min(count, SCORED), replace=False)
    cam = np.einsum("hij,nj->hni", found[:, :, :3], view.xyz[scored]) + found[:, None, :, 3]
    squares = _squares(camera, cam, view.uv[scored], sigma[scored])
    median = np.median(squares, axis=1)
    best = found[median.argmin()]
    # the median of χ² with two degrees of freedom is 2 ln 2; a sample has three points
    variance = float(median.min()) / (2 * np.log(2)) * of_small_sample(count, 3) ** 2
    return _settled(camera, view, sigma, Pose(best[:, :3], best[:, 3]), variance)


def _settled(camera: Camera, view: View, sigma: Array, pose: Pose, variance: float) -> Array:
    count = len(view)
    chosen = np.zeros(count, bool)
    freedom = float(count)
    for _ in range(ROUNDS):
        squares = _squares(camera, pose.apply(view.xyz), view.uv, sigma)
        bound = 2 * f_bound(LEVEL / count, 2, freedom)
        again = squares <= bound * variance
        if again.sum() < max(LEAST - 2, count // 2) or (again == chosen).all():
            break
        chosen = again
        fit = refine_pose(camera, view.xyz[chosen], view.uv[chosen], 1 / sigma[chosen], pose)
        if fit is None:
            return np.ones(count, bool)
        pose, freedom = fit.state, 2.0 * chosen.sum() - 6
        variance = max(2 * fit.normal.cost / freedom, ROUNDING)
    return chosen if chosen.any() else np.ones(count, bool)


def _squares(camera: Camera, cam: Array, uv: Array, sigma: Array) -> Array:
    """Squared residuals over sigma², inf outside the domain."""
    squares = np.square(camera.project(cam) - uv).sum(-1) / sigma**2
    return np.where(np.isfinite(squares), squares, np.inf)
