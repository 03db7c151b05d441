"""The effect of a cause on the camera, px."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from camcal.assess.causes.search import Trial
from camcal.assess.fold_difference import covered_grid
from camcal.geometry import rotations
from camcal.model.camera import Camera
from camcal.model.pose import Array
from camcal.solve.calibration import Calibration
from camcal.solve.warp import Warp

#: steps of the rotation between the frames; the cameras are near one another
_STEPS = 5
#: rad; the step of the derivatives, between their truncation (as the step) and rounding (as its inverse)
_TURN = 1e-6
#: rad; a smaller step moves pixels by less than a thousandth of the last printed digit
_STILL = 1e-9
#: of a standard deviation: a step that stays linear
_SMALL = 1e-2
#: pixels that determine a rotation: two equations each for three unknowns, and one to spare
_LEAST_PIXELS = 3


def effect_px(base: Calibration, trial: Trial) -> tuple[float, float]:
    """The difference in projection between the camera of all views and a trial, px: for the mean view, and rms
    over the views.

    At infinity, over the part of the picture that points cover, after the best-fitting rotation (`difference.py`).
    If each view has its own parameters, those of the mean view are zero; if views form parts, both figures are equal.
    Motion during the readout of a picture is excluded. The part due to the trial's own uncertainty is subtracted.
    """
    grid, covered = covered_grid(base)
    pixels = grid[covered]
    rays = base.camera.unproject(pixels)
    good = np.isfinite(rays).all(1)
    pixels, rays = pixels[good], rays[good]
    if len(pixels) < _LEAST_PIXELS:
        return 0.0, 0.0
    none = np.zeros_like(trial.theta)
    every = none if trial.kind == "rolling" else trial.theta
    each, counts = np.unique(every.round(9), axis=0, return_counts=True)
    squares = [_mean_square(trial, theta, rays, pixels) for theta in each]
    noise = _by_noise(base, trial, rays, pixels)
    scatter = np.average(squares, weights=counts) - noise
    mean = scatter if trial.how != "each" else _mean_square(trial, none[0], rays, pixels) - noise
    return float(np.sqrt(max(mean, 0.0))), float(np.sqrt(max(scatter, 0.0)))


def _mean_square(trial: Trial, theta: Array, rays: Array, pixels: Array) -> float:
    return float(np.nanmean(np.square(_left(trial.camera, trial.warp, theta, rays, pixels)).sum(1)))


def _by_noise(base: Calibration, trial: Trial, rays: Array, pixels: Array) -> float:
    """The mean square, px², of the difference that the trial's own uncertainty explains."""
    free = base.free[:, base.free.any(0)]
    values, vectors = np.linalg.eigh(trial.covariance)
    none, here = np.zeros(len(trial.warp.fields)), trial.camera
    at = here.project(rays)
    total = 0.0
    for value, vector in zip(values, vectors.T, strict=True):
        sigma = np.sqrt(max(float(value), 0.0))
        moved = replace(here, params=here.params + _SMALL * sigma * (free @ vector))
        off = np.square(_left(moved, trial.warp, none, rays, at)).sum(1)
        total += float(np.nanmean(off)) / _SMALL**2
    return total


def _left(camera: Camera, warp: Warp, theta: Array, rays: Array, pixels: Array) -> Array:
    """The difference (N, 2) between pixels and a mapped camera's projections of their rays, after a rotation, px."""

    def seen(turn: Array) -> Array:
        predicted = camera.project(rays @ turn.T)
        values, _ = warp.field(predicted.T)
        return np.asarray(predicted + np.einsum("k,kdn->nd", theta, values) - pixels)

    turn = np.eye(3)
    for _ in range(_STEPS):
        off = seen(turn)
        slopes = np.stack([(seen(rotations.exp(_TURN * e) @ turn) - off) / _TURN for e in np.eye(3)], -1)
        good = np.isfinite(off).all(1) & np.isfinite(slopes).all((1, 2))
        if good.sum() < _LEAST_PIXELS:
            break
        step = np.linalg.lstsq(slopes[good].reshape(-1, 3), -off[good].reshape(-1), rcond=None)[0]
        turn = rotations.exp(step) @ turn
        if np.abs(step).max() < _STILL:
            break
    return seen(turn)
