"""The layout of undistorted pictures."""

import numpy as np
import pytest

from camcal.errors import UsageError
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.lenses.undistort import undistortion


def camera(model="kb4", index=0):
    lens = lenses.make(model)
    params, size = lens.examples()[index]
    return Camera(lens, params, size)


@pytest.mark.parametrize(
    "model", ["kb4", "opencv5", "ds", "rational-function", "spline:5x4", "radial-profile"]
)
def test_every_pixel_comes_from_where_its_ray_was_seen(model):
    source = camera(model)
    made = undistortion(source, "all", (160, 120))
    seen = np.stack([made.u, made.v], -1)
    inside = made.u >= 0
    pixels = np.stack(np.meshgrid(np.arange(160.0), np.arange(120.0)), -1)[inside]
    want = source.project(made.camera.unproject(pixels))
    # float32 at a thousand px
    np.testing.assert_allclose(seen[inside], want, rtol=0, atol=1e-4)
    assert made.camera.params[0] == made.camera.params[1]


@pytest.mark.parametrize("model, index", [("kb4", 0), ("opencv5", 0), ("opencv5", 1), ("kb4", 1)])
def test_no_black_has_none_and_little_less_would(model, index):
    source = camera(model, index)
    made = undistortion(source, "no-black", (321, 241))
    assert made.black == 0
    wider = made.camera.params * [0.98, 0.98, 1, 1]
    pixels = np.stack(np.meshgrid(np.arange(321.0), np.arange(241.0)), -1)
    seen = source.project(Camera(made.camera.lens, wider).unproject(pixels))
    with np.errstate(invalid="ignore"):
        outside = ~((seen >= -0.5) & (seen <= np.array(source.image_size) - 0.5)).all(-1)
    assert outside.any()


def test_all_pixels_are_there():
    source = camera("opencv5")
    made = undistortion(source, "all")
    width, height = source.image_size
    border = np.array([[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1], [0, height / 2]])
    uv = made.camera.project(source.unproject(border))
    assert (uv >= -0.01).all() and (uv <= np.array(made.camera.image_size) - 0.99).all()
    assert 0 < made.black < 0.5


@pytest.mark.parametrize("projection, degrees", [("perspective", 90), ("equidistant", 190)])
def test_given_field(projection, degrees):
    made = undistortion(camera("kb4", 1), np.deg2rad(degrees), (400, 300), projection)
    rays = made.camera.unproject(np.array([[0.0, 149.5], [399.0, 149.5]]))
    between = np.rad2deg(np.arctan2(*rays[:, [0, 2]].T))
    np.testing.assert_allclose(between, [-degrees / 2, degrees / 2], rtol=0, atol=1e-9)


def test_straight_lines_are_straight_again():
    """Points of a line in space lie on a line in the new picture."""
    source = camera("opencv5")
    made = undistortion(source, "all")
    line = np.array([-0.4, -0.3, 1]) + np.linspace(0, 1, 20)[:, None] * [0.7, 0.5, 0.2]
    uv = made.camera.project(line)
    _, s, _ = np.linalg.svd(uv - uv.mean(0))
    assert s[1] < 1e-9


def test_too_wide_a_field():
    with pytest.raises(UsageError, match="200 degrees; at most 160"):
        undistortion(camera("kb4", 1), np.deg2rad(200))


def test_an_image_size_is_needed():
    source = camera()
    with pytest.raises(UsageError, match="image"):
        undistortion(Camera(source.lens, source.params))
