"""A camera as users of the Python API meet it."""

import re

import cv2
import numpy as np
import pytest

from camcal.errors import UsageError
from camcal.model import lenses
from camcal.model.camera import Camera


def camera(spec, skew=False):
    lens = lenses.make(spec, skew)
    return Camera(lens, *lens.examples()[0])


def points(seed=0):
    rng = np.random.default_rng(seed)
    return np.c_[rng.uniform(-0.4, 0.4, (20, 2)), np.ones(20)] * rng.uniform(1, 9, (20, 1))


@pytest.mark.parametrize(
    "spec", ["pinhole", "opencv4", "opencv5", "opencv8", "opencv14", "brown:radial=2,decentering=1"]
)
def test_opencv_projects_the_same(spec):
    made = camera(spec)
    k, distortion = made.opencv()
    uv = cv2.projectPoints(points(), np.zeros(3), np.zeros(3), k, distortion)[0].reshape(-1, 2)
    np.testing.assert_allclose(uv, made.project(points()), rtol=0, atol=1e-9)


@pytest.mark.parametrize("spec", ["kb4", "kb:2"])
def test_opencv_fisheye_projects_the_same(spec):
    made = camera(spec)
    k, distortion = made.opencv()
    assert distortion.shape == (4,)
    uv = cv2.fisheye.projectPoints(points()[None], np.zeros(3), np.zeros(3), k, distortion)[0].reshape(-1, 2)
    np.testing.assert_allclose(uv, made.project(points()), rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    "made, said",
    [
        (camera("ds"), "no counterpart of the model 'ds'"),
        (camera("kb:6"), "no counterpart of the model 'kb:6'"),
        (camera("mei"), "'mei': cv2.omnidir also takes xi"),
        (camera("opencv5", skew=True), "a skew of 0.7 px"),
        (camera("kb4", skew=True), "a skew of 0.8 px"),
    ],
    ids=lambda value: value if isinstance(value, str) else value.lens.name,
)
def test_what_opencv_cannot_hold_is_refused(made, said):
    with pytest.raises(UsageError, match=re.escape(said)) as error:
        made.opencv()
    assert error.value.hint


def test_a_skew_of_zero_is_no_skew():
    lens = lenses.make("opencv5", skew=True)
    params, size = lens.examples()[0]
    params[4] = 0.0
    assert Camera(lens, params, size).opencv()[0][0, 1] == 0.0


def test_repr_is_one_line():
    assert repr(camera("pinhole")) == "<Camera pinhole 640x480: fx=533, fy=534, cx=341, cy=234>"
    assert repr(camera("spline:5x4")).endswith("... 36 more>") and "\n" not in repr(camera("spline:5x4"))
    params = camera("opencv5").params
    assert repr(Camera(lenses.make("opencv5"), params)).startswith("<Camera opencv5: fx=533,")


def test_notebook_table():
    html = camera("opencv5")._repr_html_()
    assert html.count("<tr>") == 9 and "<caption>opencv5, 640 x 480 px</caption>" in html
    assert "<td>k1</td><td>-0.28</td>" in html
