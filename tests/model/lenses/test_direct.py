"""Linear solutions: exact on exact pairs, near on noisy ones."""

import numpy as np
import pytest

from camcal.model import lenses
from camcal.model.lenses import direct
from camcal.model.lenses.regress import measure, regress

EXACT = ["bicubic", "polynomial:2", "polynomial:5", "rational-function"]


def pairs(lens, index=0, noise=0.0):
    params, (width, height) = lens.examples()[index]
    u, v = np.meshgrid(np.linspace(0, width - 1, 24), np.linspace(0, height - 1, 18))
    uv = np.c_[u.ravel(), v.ravel()]
    rays, valid = lens.unproject(params, uv)
    assert valid.all()
    return params, rays, uv + noise * np.random.default_rng(0).normal(size=uv.shape)


@pytest.mark.parametrize("index", [0, 1])
@pytest.mark.parametrize("spec", EXACT)
def test_exact_pairs_give_the_camera(spec, index):
    lens = lenses.make(spec, skew=True)
    params, rays, uv = pairs(lens, index)
    found = lens.from_values(lens.shapes(rays, uv, None)[0])
    # parameters of up to 2340 px, after a least squares problem with a condition number of some 1e4
    np.testing.assert_allclose(found, params, rtol=0, atol=1e-8)


@pytest.mark.parametrize("spec", ["division:1", "division:3", "scaramuzza"])
def test_radial_models_with_square_pixels(spec):
    lens = lenses.make(spec)
    params, rays, uv = pairs(lens)
    params = params.copy()
    params[1] = params[0]
    uv, _ = lens.project(params, rays)
    found = lens.from_values(lens.shapes(rays, uv, None)[0])
    # the centre is iterated until it moves by less than 1e-9 of the image
    np.testing.assert_allclose(found, params, rtol=0, atol=1e-5)


@pytest.mark.parametrize("spec", [*EXACT[:3], "rational-function", "division:2"])
def test_noisy_pairs(spec):
    """Refined in px, the errors are the noise; the linear solution alone is within a px of it."""
    lens = lenses.make(spec, skew=True)
    _, rays, uv = pairs(lens, noise=0.2)
    linear = measure(lens, lens.from_values(lens.shapes(rays, uv, None)[0]), rays, uv)
    assert linear.covered.all() and linear.rms < 1.0
    refined = regress(lens, rays, uv, hold=())
    # 0.2 px in each of two coordinates, less what some 20 parameters of 864 coordinates take up
    assert 0.26 < refined.rms < 0.2 * np.sqrt(2)
    assert refined.rms <= linear.rms


def test_too_few_rays():
    rays = np.array([[0, 0, 1.0], [0.1, 0, 1], [0, 0.1, 1]])
    uv = np.array([[320.0, 240], [370, 240], [320, 290]])
    assert direct.polynomial(rays, uv, 3) is None
    assert direct.rational_function(rays, uv) is None
    assert lenses.make("bicubic").shapes(rays, uv, None) == [{}]


def test_a_mirrored_picture_has_no_solution():
    lens = lenses.make("bicubic")
    _, rays, uv = pairs(lens)
    assert direct.polynomial(rays * [-1, 1, 1], uv, 3) is None
