"""The middle of the picture where the data leave the principal point or centre of distortion undetermined."""

import numpy as np
import pytest

from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.report.lines import _warnings
from camcal.routes import assumed_centre
from camcal.routes.line_geometry import Lines
from camcal.routes.line_start import estimate
from tests.routes.test_lines import SIZE, lines_of
from tests.sides import LESS, MORE

DIVISION = Camera(lenses.make("division:1"), np.array([1280.0, 1280, 648, 474, -0.2]), SIZE)
STRAIGHT = Camera(lenses.make("pinhole"), np.array([1280.0, 1280, 640, 480]), SIZE)
OWN = lenses.make("brown:radial=1,decentering=0,centre=free")


@pytest.mark.parametrize(("share", "names"), [(LESS, ()), (MORE, ("cx",))])
def test_a_principal_point_that_is_known_too_badly(share, names):
    bound = assumed_centre.CENTRE * 1280
    sigmas = np.array([1.0, 1.0, share * bound, 1.0, 0.1])
    assert assumed_centre.undetermined(DIVISION, sigmas, ("cx", "cy")) == names
    own = Camera(OWN, np.array([1280.0, 1280, 639.5, 479.5, 0, 0, -0.2]), SIZE)
    sigmas = np.array([0.0, 0, 0, 0, share * bound / 1280, 0, 0.1])  # in focal lengths
    assert len(assumed_centre.undetermined(own, sigmas, ("xc", "yc"))) == len(names)


def test_the_doubt_is_that_of_one_standard_deviation():
    slope = np.array([2.0, 0, 0, 0, 0.01])

    def refitted(moved, name):
        assert name == "cx"
        return moved.params + slope * (moved.params[2] - 648)

    covariance = assumed_centre.doubt(DIVISION, ("cx",), refitted)
    sigma = assumed_centre.CENTRE * 1280
    np.testing.assert_allclose(np.sqrt(np.diagonal(covariance)), sigma * np.abs(slope), atol=1e-9)
    assert not assumed_centre.doubt(DIVISION, ("cx", "cy"), lambda *_: None).any()


def test_lines_of_one_direction_leave_the_centre_along_them_in_the_middle():
    rng, x = np.random.default_rng(0), np.linspace(-0.4, 0.4, 15)
    parts = [DIVISION.project(np.c_[x, np.full(15, y), np.ones(15)]) for y in np.linspace(-0.3, 0.3, 10)]
    level = Lines.of([p + rng.normal(0, 0.2, p.shape) for p in parts], list("abcdefghij"), SIZE)
    found = estimate(level, DIVISION.lens, {}, robust=False)
    assert found.assumed == ("cx",) and found.camera.values["cx"] == 639.5
    assert abs(found.camera.values["cy"] - 474) < 4 * np.sqrt(found.covariance[3, 3])
    assert abs(found.camera.values["l1"] + 0.2) < 3 * np.sqrt(found.covariance[4, 4]) < 0.1
    assert [w["code"] for w in _warnings(found, level)] == ["one-direction", "principal-point-assumed"]


@pytest.mark.parametrize("lens", [DIVISION.lens, OWN])
def test_lines_without_distortion_leave_the_centre_in_the_middle(lens):
    lines = lines_of(STRAIGHT, 20, 0.2, points=15)
    found = estimate(lines, lens, {}, robust=True, resistant=True)
    assert len(found.assumed) == 2 and found.iterations < 50
    at = found.camera.lens.names.index
    middle = (0.0, 0.0) if lens is OWN else (639.5, 479.5)
    assert tuple(found.camera.params[[at(n) for n in found.assumed]]) == middle
    assert abs(found.camera.params[-1]) < 4 * np.sqrt(found.covariance[-1, -1])


def test_a_centre_that_lines_determine_is_free():
    found = estimate(lines_of(DIVISION, 20, 0.2, points=15), DIVISION.lens, {}, robust=False)
    assert found.assumed == ()
    assert np.abs((found.camera.params - DIVISION.params)[2:4]).max() < 4 * np.sqrt(found.covariance[2, 2])
