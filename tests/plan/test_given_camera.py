"""`start_camera`: the refinement begins with a camera that is known."""

from dataclasses import replace

import numpy as np
import pytest

from camcal.errors import UsageError
from camcal.model import lenses
from camcal.plan.calibrate import calibrate
from camcal.report.opening import load, save_camera
from tests.solved import camera_of, grid, observe, tilted_poses


@pytest.fixture(scope="module")
def data():
    rng = np.random.default_rng(4)
    return observe(camera_of(), tilted_poses(grid(), 8, rng), grid(), 0.1, rng)


@pytest.fixture(scope="module")
def plain(data):
    return calibrate(data, model="opencv5", checks=False)


def test_the_optimum_is_the_same(data, plain, tmp_path):
    given = camera_of(values={**camera_of().values, "fx": 515.0, "fy": 512.0, "k1": -0.2})
    save_camera(given, tmp_path / "cam.yml")
    for start in (given, tmp_path / "cam.yml", str(tmp_path / "cam.yml")):
        found = calibrate(data, model="opencv5", checks=False, start_camera=start)
        assert [s.name for s in found.stages] == ["given", "refine"]
        assert found.start.params.tolist() == given.params.tolist()
        # the same minimum, reached from elsewhere: sigmas of fx are 0.3 px
        assert np.abs(found.camera.params - plain.camera.params)[:4].max() < 1e-3
    found.save(tmp_path / "r.yaml")
    assert load(tmp_path / "r.yaml").options["start_camera"]["value"].endswith("cam.yml")


def test_a_camera_of_another_model(data, plain):
    """The nearest camera of the model that is calibrated is where the search begins."""
    other = camera_of("opencv4", {n: v for n, v in camera_of().values.items() if n != "k3"})
    found = calibrate(data, model="opencv5", checks=False, start_camera=other)
    assert found.camera.lens == lenses.make("opencv5")
    assert np.abs(found.camera.params - plain.camera.params)[:4].max() < 1e-3


@pytest.mark.parametrize(
    "more, words",
    [
        ({"start": "zhang"}, "a closed form"),
        ({"start_camera": replace(camera_of(), image_size=(320, 240))}, "320x240"),
    ],
)
def test_refusals(data, more, words):
    with pytest.raises(UsageError, match=words):
        calibrate(data, model="opencv5", checks=False, **{"start_camera": camera_of(), **more})
