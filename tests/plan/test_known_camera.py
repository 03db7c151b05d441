"""A camera judged on data of which the truth is known."""

from dataclasses import replace

import numpy as np
import pytest

from camcal.assess.covariance import covariance
from camcal.errors import DataError
from camcal.model.placement import simulate_poses
from camcal.plan.known_camera import evaluate
from camcal.study.cameras import example_camera
from camcal.study.points import corner_rig, facing_corner, simulate_points
from tests.solved import grid

BOARD = grid()


def data_of(model, points, noise=0.0, base=None, views=5, outliers=0.0):
    rng = np.random.default_rng(4)
    camera = example_camera(model)
    poses = simulate_poses(points, camera, rng, views, base=base)
    return camera, poses, simulate_points(camera, points, poses, rng, noise, outliers)


@pytest.mark.parametrize("model", ["pinhole", "opencv8", "kb4"])
@pytest.mark.parametrize(
    ("points", "base"), [(BOARD, None), (corner_rig(), facing_corner())], ids=["board", "rig"]
)
def test_the_true_camera_explains_exact_data(model, points, base):
    camera, poses, data = data_of(model, points, base=base)
    found = evaluate(camera, data)
    # 1e-9 px: nine digits below a pixel, four above the rounding of coordinates of some hundred px
    assert found.rms_point < 1e-9
    assert found.camera.params.tolist() == camera.params.tolist()
    # the scale of the unit is that of the points; 1e-9 relative, as for the pixels
    assert (
        np.abs(found.poses.translations - poses.translations).max() < 1e-9 * np.abs(poses.translations).max()
    )
    assert np.abs(found.poses.rotations - poses.rotations).max() < 1e-9
    assert found.free.shape == (len(camera.params), 0)
    assert set(covariance(found).sigmas.values()) == {0.0}


def test_noise_is_found_again():
    camera, _, data = data_of("opencv5", BOARD, noise=0.2, views=12)
    found = evaluate(camera, data)
    # 1224 degrees of freedom (12 x 54 points, 72 pose parameters): sigma is found to 2 %; 4 times that
    sigma = np.sqrt((found.used_residuals**2).sum() / (2 * data.point_count - found.free_count))
    assert sigma == pytest.approx(0.2, rel=0.08)


def test_outliers():
    camera, _, data = data_of("opencv5", BOARD, noise=0.2, views=8, outliers=0.05)
    found = evaluate(camera, data, robust="auto")
    assert evaluate(camera, data).rms_point > 2  # 5 % moved by 5 to 60 px
    assert found.rms_point < 0.4  # sqrt(2) * 0.2 for each point, with room for its scatter
    assert (~found.used).sum() >= 0.03 * data.point_count


def test_another_camera_does_not_explain_them():
    camera, _, data = data_of("opencv5", BOARD)
    params = camera.params.copy()
    params[2] += 40.0  # the principal point, px; a focal length alone the poses would absorb in part
    assert evaluate(replace(camera, params=params), data).rms_point > 0.05


def test_pictures_of_another_size():
    camera, _, data = data_of("opencv5", BOARD)
    with pytest.raises(DataError, match="64x48"):
        evaluate(camera, replace(data, image_sizes=((64, 48),)))
