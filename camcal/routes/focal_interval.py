"""The 95 % interval of a focal length from two or three views, which is not symmetric.

The residuals of a bundle depend on 1 / f² far more linearly than on f: the standard deviation grows with f by its
second to third power, and f ± 1.96 σ is too short below and too long above. The interval is that of the profile
likelihood (Venzon & Moolgavkar, A method for computing profile-likelihood-based confidence intervals, 1988): the f
between which the least sum of squares with f held exceeds the least of all by less than t² of the noise's variance.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from camcal.least_squares.distributions import t_bound
from camcal.model.pose import Array
from camcal.routes.bundle import Bundle, Tracks, adjust, freedom

LEVEL = 0.95
#: relative standard deviation below which the interval is symmetric: ends are then off by less than 5 % of its half
NEARLY_SYMMETRIC = 0.02
#: secant steps for each end, and the relative error of t² that ends them: a hundredth of the half width
STEPS, CLOSE = 8, 0.02


def focal_interval(bundle: Bundle, tracks: Tracks, free: Array, sigma: float) -> tuple[float, float]:
    """The 95 % interval of the focal length of an adjusted bundle, px; infinite where f has no upper limit.

    Parameters
    ----------
    tracks : Tracks
        The images used.
    free : (P, F) array
        d parameters / d free parameters, the focal length among them.
    sigma : float
        Its standard deviation, px.
    """
    f, left = float(bundle.camera.params[0]), freedom(tracks, free)
    t = t_bound((1 - LEVEL) / 2, left)
    if sigma <= NEARLY_SYMMETRIC * f:
        return f - t * sigma, f + t * sigma
    held = free[:, free[0] == 0]
    best = float(np.square(bundle.residuals(tracks)).sum())
    ends = []
    for side in (1.0, -1.0):  # of 1 / f²: the lower end of f first
        step, at = side * 2 * t * sigma / f**3, bundle
        end = np.inf
        for _ in range(STEPS):
            inverse = 1 / f**2 + step
            if inverse <= 0:
                end = np.inf
                break
            end = 1 / np.sqrt(inverse)
            rest = _with_focal(at, tracks, held, end)
            if rest is None:
                break
            at, excess = rest[0], (rest[1] - best) / (best / left)
            if abs(excess - t**2) <= CLOSE * t**2:
                break
            # the excess is nearly quadratic in 1 / f²
            step *= t / np.sqrt(max(excess, (t / 2) ** 2))
        ends.append(float(end))
    return ends[0], ends[1]


def _with_focal(bundle: Bundle, tracks: Tracks, held: Array, focal: float) -> tuple[Bundle, float] | None:
    """The bundle adjusted with the focal length held, and its sum of squares, px²."""
    params = bundle.camera.params.copy()
    params[:2] *= focal / params[0]
    fitted = adjust(replace(bundle, camera=replace(bundle.camera, params=params)), tracks, held)
    return None if fitted is None else (fitted.state, 2 * fitted.normal.cost)
