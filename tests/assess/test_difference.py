"""The difference of two cameras: zero for the same camera, and what it should be for another."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from camcal.assess.difference import difference, grid_of, image_grid
from camcal.geometry import rotations
from camcal.model.camera import Camera
from camcal.model.lenses import make
from tests.solved import TRUTH, camera_of


def test_a_camera_does_not_differ_from_itself():
    d = difference(camera_of(), camera_of())
    # two roundings of coordinates near 1e3 px, through a Newton inverse
    assert d.max_px < 1e-9 and d.outside == 0


def test_the_same_lens_in_another_model_does_not_differ():
    assert difference(camera_of("opencv5"), camera_of("opencv8")).max_px < 1e-9


@given(st.floats(-4, 4), st.floats(-4, 4))
@settings(max_examples=15, deadline=None)
def test_a_shifted_principal_point_is_mostly_a_rotation(dx, dy):
    shifted = camera_of(values=TRUTH | {"cx": TRUTH["cx"] + dx, "cy": TRUTH["cy"] + dy})
    d = difference(camera_of(), shifted)
    shift = np.hypot(dx, dy)
    # what a rotation cannot take up is of second order in the field of view: a third here, not all of it
    assert d.max_px <= 0.6 * shift + 1e-9
    # the rotation found is the shift seen from the focal length
    angle = np.linalg.norm(d.b_from_a.rotation - np.eye(3)) / np.sqrt(2)
    assert angle == pytest.approx(shift / 533, rel=0.25, abs=1e-9)


def test_the_rotation_found_is_the_best():
    other = camera_of(values=TRUTH | {"fx": 540.0, "cx": 330.0, "k1": -0.2})
    a, b = camera_of(), other
    d = difference(a, b)
    rays = a.unproject(d.pixels)
    for axis in range(3):
        for sign in (-1, 1):
            turned = rotations.exp(sign * 1e-4 * np.eye(3)[axis]) @ d.b_from_a.rotation
            worse = np.linalg.norm(b.project(rays @ turned.T) - d.pixels, axis=1)
            assert np.mean(worse**2) >= d.rms_px**2


def test_a_longer_focal_length_shows_at_the_corners():
    a = camera_of("pinhole")
    b = Camera(a.lens, a.params * [1.01, 1.01, 1, 1], a.image_size)
    d = difference(a, b)
    # 1 % of the distance from the principal point, about 400 px at the corner
    assert d.max_px == pytest.approx(4.0, rel=0.05)
    assert np.hypot(d.worst[0] - 322, d.worst[1] - 238) > 390


def test_at_a_distance_a_translation_takes_up_the_focal_length():
    a = camera_of("pinhole")
    b = Camera(a.lens, a.params * [1.01, 1.01, 1, 1], a.image_size)
    # rays of equal length on a sphere of 40 degrees: moving back by about 1 % explains most of it
    assert difference(a, b, distance=10.0).max_px < 0.5 * difference(a, b).max_px


def test_pixels_outside_a_domain_are_counted():
    lens = make("opencv5")
    folding = Camera(lens, lens.from_values(TRUTH | {"k1": -0.5, "k2": 0.0, "k3": 0.0}), (640, 480))
    d = difference(camera_of(), folding)
    assert 0 < d.outside < len(d.pixels)
    assert np.isfinite(d.max_px) and np.isnan(d.vectors).any(1).sum() == d.outside


def test_nothing_in_common():
    lens = make("opencv4")
    blind = Camera(lens, lens.from_values(TRUTH | {"k1": -500.0, "k2": 0.0}), (640, 480))
    d = difference(camera_of(), blind, image_grid(np.zeros(2), np.array([100, 100])))
    assert d.outside == len(d.pixels) and np.isnan(d.max_px) and d.worst is None


def test_the_grid_holds_the_corners():
    g = grid_of((640, 480))
    assert g.min(0).tolist() == [0, 0] and g.max(0).tolist() == [639, 479]
    assert len(g) == 40 * 30


def test_without_a_size_pixels_are_needed():
    a = Camera(camera_of().lens, camera_of().params)
    with pytest.raises(ValueError, match="image size"):
        difference(a, a)
    assert difference(a, a, grid_of((100, 100))).max_px < 1e-9
