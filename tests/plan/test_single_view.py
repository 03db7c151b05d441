"""One view of a plane: the principal point is free where a distorting lens shows it, whatever the closed form."""

import numpy as np
import pytest

from camcal.data.observations import Observations, View
from camcal.errors import DataError
from camcal.geometry import rotations
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from camcal.plan.calibrate import calibrate

SIZE = (1280, 960)
POSE = Pose(rotations.exp([0.5, 0.4, 0.2]), np.array([0.1, -0.1, 4.0]))
GRID = np.stack(np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-0.8, 0.8, 7), [0.0]), -1).reshape(-1, 3)


def view(xyz, distortion, noise=0.2):
    camera = Camera(lenses.make("division:1"), np.array([1000.0, 1000, 645, 470, distortion]), SIZE)
    uv = camera.project(POSE.apply(xyz)) + np.random.default_rng(0).normal(0, noise, (len(xyz), 2))
    return Observations.from_views([View("v", xyz, uv)], SIZE)


@pytest.mark.parametrize("start", ["tsai", "claus", "fitzgibbon"])
def test_an_undetermined_principal_point_is_held(start):
    found = calibrate(view(GRID, 0.0), model="division:1", start=start, crosscheck=False)
    values = found.camera.values
    assert np.hypot(values["cx"] - 645, values["cy"] - 470) < 40 and abs(values["fx"] - 1000) < 40
    assert "single-view" in [w.code for w in found.warnings]


def test_a_principal_point_that_the_distortion_shows_is_free():
    found = calibrate(view(GRID, -0.4, 0.05), model="division:1", start="tsai", crosscheck=False)
    values = found.camera.values
    assert abs(values["cx"] - 645) < 6 and abs(values["cy"] - 470) < 6


def test_mirrored_points_in_space_are_named_by_tsai():
    seen = view(np.random.default_rng(1).uniform(-1, 1, (40, 3)), -0.1)
    seen.views[0].uv[:, 0] = SIZE[0] - 1 - seen.views[0].uv[:, 0]
    with pytest.raises(DataError, match="mirrored"):
        calibrate(seen, model="division:1", start="tsai", crosscheck=False)
