"""Tables of points of cameras of one type, for the tests of batches."""

import numpy as np

from camcal.data.observations import Correspondences
from camcal.data.writing import write_points
from camcal.geometry import rotations
from camcal.model import lenses

GRID = np.c_[np.mgrid[0:7, 0:5].reshape(2, -1).T, np.zeros(35)]


def write_camera(path, seed=0, focal=800.0, views=6, noise=0.1):
    """Write a table of a camera with a pinhole lens; returns its focal length."""
    rng = np.random.default_rng(seed)
    lens = lenses.make("pinhole")
    params = lens.pinhole(focal, focal, 320, 240)
    seen = []
    for _ in range(views):
        rotation = rotations.exp(rng.uniform(-0.5, 0.5, 3))
        translation = np.array([-3.0, -2, 14]) + rng.uniform(-1, 1, 3)
        uv = lens.project(params, GRID @ rotation.T + translation)[0]
        seen.append((GRID, uv + rng.normal(0, noise, uv.shape)))
    write_points(path, Correspondences.from_views(seen, image_size=(640, 480)), force=True)
    return focal


def row(name, **values):
    """A row as of a finished job."""
    made = {
        "name": name, "type": "", "status": "done", "reason": "", "rms_point": 0.2, "verdict": "pass",
        "grade": "good", "warnings": "", "model": "opencv5", "image_size": "640x480", "views": 20, "points": 1000,
        "focal": 800.0, "sigma_focal": 0.5, "cx": 320.0, "sigma_cx": 0.5, "cy": 240.0, "sigma_cy": 0.5,
        "distortion": -5.0, "holdout": 0.25, "seconds": 0.1,
    }  # fmt: skip
    return {**made, **values}
