"""How far a cause puts the camera off, px."""

from __future__ import annotations

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
_TURN = 1e-6


def effect_px(base: Calibration, trial: Trial) -> float:
    """How far the camera of all views projects from what a trial says of each view: rms over views and picture, px.

    At infinity, over the part of the picture that points cover, after the rotation that fits best (`difference.py`).
    """
    grid, covered = covered_grid(base)
    pixels = grid[covered]
    rays = base.camera.unproject(pixels)
    good = np.isfinite(rays).all(1)
    pixels, rays = pixels[good], rays[good]
    if len(pixels) < 3:
        return 0.0
    # what moved while a picture was read is not the camera's
    theta = np.zeros_like(trial.theta) if trial.kind == "rolling" else trial.theta
    each, counts = np.unique(theta.round(9), axis=0, return_counts=True)
    squares = [np.square(_left(trial.camera, trial.warp, theta, rays, pixels)).sum(1) for theta in each]
    means = np.array([np.nanmean(s) for s in squares])
    return float(np.sqrt(np.average(means, weights=counts)))


def _left(camera: Camera, warp: Warp, theta: Array, rays: Array, pixels: Array) -> Array:
    """What is left (N, 2) between pixels and where a mapped camera sees their rays, after a rotation, px."""

    def seen(turn: Array) -> Array:
        predicted = camera.project(rays @ turn.T)
        values, _ = warp.field(predicted.T)
        return np.asarray(predicted + np.einsum("k,kdn->nd", theta, values) - pixels)

    turn = np.eye(3)
    for _ in range(_STEPS):
        off = seen(turn)
        slopes = np.stack([(seen(rotations.exp(_TURN * e) @ turn) - off) / _TURN for e in np.eye(3)], -1)
        good = np.isfinite(off).all(1) & np.isfinite(slopes).all((1, 2))
        if good.sum() < 3:
            break
        step = np.linalg.lstsq(slopes[good].reshape(-1, 3), -off[good].reshape(-1), rcond=None)[0]
        turn = rotations.exp(step) @ turn
    return seen(turn)
