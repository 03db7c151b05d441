"""Lenses from pairs of ideal and distorted points, and cameras of other models."""

import numpy as np
import pytest

from camcal.errors import DataError, EstimationError, UsageError
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.lenses.conversion import convert
from camcal.model.lenses.pairs import SCATTER, fit_pairs


def pairs(noise=0.1):
    lens = lenses.make("opencv5")
    params, (width, height) = lens.examples()[0]
    u, v = np.meshgrid(np.linspace(0, width - 1, 25), np.linspace(0, height - 1, 19))
    uv = np.c_[u.ravel(), v.ravel()]
    rays, _ = lens.unproject(params, uv)
    return rays[:, :2] / rays[:, 2:], uv + noise * np.random.default_rng(0).normal(size=uv.shape)


@pytest.mark.parametrize(
    "spec, bound",
    # px; the noise is .141, what is above it is the model's own misfit to this lens, as measured
    [
        ("rational-function", 0.24),
        ("bicubic", 0.68),
        ("polynomial:5", 0.145),
        ("division:2", 0.30),
        ("opencv5", 0.145),
    ],
)
def test_fit(spec, bound):
    ideal, uv = pairs()
    found = fit_pairs(lenses.make(spec), ideal, uv)
    assert found.refined.covered.all() and found.refined.rms < bound
    assert (found.direct is None) == (spec == "opencv5")
    if found.direct is not None:
        assert found.refined.rms <= found.direct.rms
    assert not found.assumed


def test_ideal_pixels_say_the_same():
    """The map between the pictures does not depend on the camera that the ideal pixels are thought to be of."""
    ideal, uv = pairs()
    matrix = np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])
    px = ideal @ matrix[:2, :2].T + matrix[:2, 2]
    lens = lenses.make("rational-function", skew=True)
    known, assumed = fit_pairs(lens, px, uv, matrix), fit_pairs(lens, px, uv)
    assert assumed.assumed and not known.assumed
    # A absorbs any change of the plane's coordinates but a rotation, which `turns` frees
    assert abs(known.refined.rms - assumed.refined.rms) < 1e-3


def test_too_few_pairs():
    ideal, uv = pairs()
    with pytest.raises(DataError, match="5 pairs give 10 equations for the 19 parameters"):
        fit_pairs(lenses.make("bicubic"), ideal[:5], uv[:5])


def test_conversion():
    lens = lenses.make("kb4")
    params, size = lens.examples()[0]
    source = Camera(lens, params, size)
    found = convert(source, lenses.make("opencv8"))
    assert found.max_px < 0.1 and found.without_ray == 0
    np.testing.assert_allclose(found.camera.project(source.unproject(found.pixels)), found.pixels, atol=0.1)
    assert convert(source, lenses.make("opencv4")).max_px > 1
    with pytest.raises(UsageError, match="image"):
        convert(Camera(lens, params), lens)


def test_views_of_a_board_are_no_pairs():
    board = np.stack(np.meshgrid(np.arange(6.0), np.arange(5.0)), -1).reshape(-1, 2)
    seen = np.concatenate([100 * board + 50, 80 * board + 90])
    with pytest.raises(DataError, match="is given 2 times"):
        fit_pairs(lenses.make("opencv5"), np.concatenate([board, board]), seen)


@pytest.mark.parametrize("extent, pixels", [(19.8, False), (20.2, True)])
def test_ideal_points_that_spread_far_are_pixels(extent, pixels):
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, 9), np.linspace(-0.4, 0.4, 7))
    ideal = extent * np.c_[x.ravel(), y.ravel()]
    assert fit_pairs(lenses.make("pinhole"), ideal, 30 * ideal + 300).assumed == pixels


@pytest.mark.parametrize("part, repeated", [(0.9, True), (1.1, False)])
def test_how_far_repeated_measurements_may_scatter(part, repeated):
    ideal, uv = pairs()
    again = uv[100] + [2 * part * SCATTER * np.ptp(uv[:, 0]), 0.0]  # either is half of that from their mean
    ideal, uv = np.r_[ideal, ideal[[100]]], np.r_[uv, [again]]
    if repeated:
        assert fit_pairs(lenses.make("opencv5"), ideal, uv).refined.covered.all()
    else:
        with pytest.raises(DataError, match="given 2 times"):
            fit_pairs(lenses.make("opencv5"), ideal, uv)


def test_a_camera_with_hardly_a_ray_is_not_converted():
    """A fold next to the centre: the part of the image with a ray shrinks with k1."""
    lens = lenses.make("opencv4")
    params, size = lens.examples()[0]
    with pytest.raises(EstimationError, match="pixels of the camera's image have a ray; at least 12"):
        convert(Camera(lens, params * [1, 1, 1, 1, 1e5, 0, 0, 0], size), lenses.make("pinhole"))
