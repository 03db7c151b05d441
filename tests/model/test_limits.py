"""Numbers of simulated poses and of rectified pictures, each just below and just above."""

from types import SimpleNamespace

import numpy as np
import pytest

from camcal.errors import EstimationError, UsageError
from camcal.geometry import hull, picture
from camcal.model import lenses, placement, rectification
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from tests.sides import LESS, MORE

CAMERA = Camera(lenses.make("pinhole"), np.array([800.0, 800, 499.5, 399.5]), (1000, 800))
SQUARE = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])


# ------------------------------------------------------------------------------------ simulated poses
@pytest.mark.parametrize("fill", [0.2, 0.5, 0.9])
def test_how_well_a_size_is_met(fill):
    """To half a per cent, and not much better: the search ends there."""
    ratios = []
    for place in np.random.default_rng(0).uniform(200, 600, (12, 2)):
        pose = placement._at_pixel(SQUARE, CAMERA, np.eye(3), place, fill)
        uv = CAMERA.project(pose.apply(SQUARE))
        ratios.append(abs(float((np.ptp(uv, axis=0) / CAMERA.image_size).max()) / fill - 1))
    assert max(ratios) < placement.FILL_ERROR


@pytest.mark.parametrize(("share", "ends"), [(LESS, True), (MORE, False)])
def test_the_end_of_the_search_for_a_distance(share, ends):
    """Each time the size is off by as much, here."""
    asked = []
    width = (1 + share * placement.FILL_ERROR) * 0.5 * 1000

    def project(points):
        asked.append(1)
        return np.array([[0.0, 0], [width, 0]])

    camera = SimpleNamespace(
        image_size=(1000, 800), unproject=lambda _: np.array([0.0, 0, 1]), project=project
    )
    placement._at_pixel(SQUARE, camera, np.eye(3), np.zeros(2), 0.5)
    assert len(asked) == (1 if ends else placement.STEPS)


@pytest.mark.parametrize(
    ("ratio", "factor"), [(10.0, 1.4), (0.1, 0.7), (1.39, 1.39), (0.71, 0.71), (None, 1.5)]
)
def test_steps_of_a_distance(ratio, factor):
    """They are limited, and an object outside the lens's domain is moved away."""
    distances = []

    def project(points):
        distances.append(points[:, 2].mean())
        size = np.nan if ratio is None else ratio * 500
        return np.array([[0.0, 0], [size, 0]])

    camera = SimpleNamespace(
        image_size=(1000, 800), unproject=lambda _: np.array([0.0, 0, 1]), project=project
    )
    placement._at_pixel(SQUARE, camera, np.eye(3), np.zeros(2), 0.5)
    assert distances[1] / distances[0] == pytest.approx(factor)


def placed(monkeypatch, enough):
    """The sizes and the places that are tried until one fits."""
    asked = []

    def at_pixel(_, __, ___, pixel, fill):
        asked.append((pixel.copy(), fill))
        return Pose(np.eye(3), np.zeros(3)) if len(asked) > enough else None

    monkeypatch.setattr(placement, "_at_pixel", at_pixel)
    camera = SimpleNamespace(image_size=(1000, 800), project=lambda _: np.array([[500.0, 400]]))
    placement._place(SQUARE, camera, np.eye(3), np.array([0.0, 0.0]), 0.8, 0.02)
    return asked


def test_attempts_at_a_place(monkeypatch):
    """Each a little smaller, to three quarters, and a fifth of the way closer to the middle."""
    last = placement.ATTEMPTS - 1
    asked = placed(monkeypatch, last)
    assert len(asked) == last + 1
    fills = np.array([fill for _, fill in asked]) / 0.8
    assert fills[:9] == pytest.approx(0.97 ** np.arange(9)) and fills[10:] == pytest.approx(0.75)
    left = np.array([np.linalg.norm(pixel - (499.5, 399.5)) for pixel, _ in asked])
    assert left[1:] / left[:-1] == pytest.approx(0.8)
    assert left[-1] / left[0] < 2e-4
    with pytest.raises(UsageError, match="no pose shows the whole object"):
        placed(monkeypatch, last + 1)


def test_azimuths_and_places_that_cover():
    """The golden angle leaves no gap larger than a fifth of a turn among eight, Roberts' sequence none of a third."""
    turns = np.sort(np.arange(8) * placement.GOLDEN_ANGLE % (2 * np.pi))
    gaps = np.diff(np.r_[turns, turns[0] + 2 * np.pi])
    assert gaps.max() < 2 * np.pi / 5 and gaps.min() > 2 * np.pi / 20
    places = np.arange(1, 101)[:, None] * placement.R2_STEP % 1
    for axis in places.T:
        assert np.diff(np.r_[0, np.sort(axis), 1]).max() < 0.03
    plastic = np.roots([1, 0, -1, -1]).real.max()
    np.testing.assert_allclose(placement.R2_STEP, [1 / plastic, 1 / plastic**2], atol=1e-14)


# ------------------------------------------------------------------------------------ pictures
@pytest.mark.parametrize(("off", "inside"), [(LESS, True), (MORE, False)])
def test_the_border_of_a_picture(off, inside):
    """Half a pixel beyond the centres of the outermost ones."""
    uv = np.array([[-off / 2, 1.0], [1.0, -off / 2], [9 + off / 2, 1.0], [1.0, 4 + off / 2]])
    assert (picture.in_picture(uv, (10, 5)) == inside).all()


def test_points_that_can_be_corners_of_a_hull():
    """Some per cent of many; the corners are those of all points."""
    points = np.random.default_rng(0).normal(size=(4000, 2))
    assert 0.0 < hull._outer(points).mean() < 0.05
    corners = hull.hull(points)
    few = hull.hull(points[hull._outer(points)])
    np.testing.assert_array_equal(corners, few)


@pytest.mark.parametrize(
    ("kind", "degrees"), [(rectification.PERSPECTIVE, 80), (rectification.LATITUDE_LONGITUDE, 85)]
)
@pytest.mark.parametrize("share", [LESS, MORE])
def test_angles_that_rectified_pictures_show(kind, degrees, share):
    angle = np.radians(share * degrees)
    flat = rectification._flat(np.array([[np.sin(angle), 0.0, np.cos(angle)]]), kind, 0)
    assert np.isfinite(flat).all() == (share < 1)


def test_pictures_that_share_nothing(monkeypatch):
    """The search for a scale without black ends at a thousand times the smallest one."""
    asked, least = [], [0.0]

    def sources(*_):
        return None, np.array([asked[-1] >= least[0]])

    def at(focal):
        asked.append(focal)
        return SimpleNamespace(cameras=[None], turns=[None], image_size=(9, 9), rays=lambda _: None)

    monkeypatch.setattr(rectification, "_sources", sources)
    monkeypatch.setattr(rectification, "bisected", lambda *a: a[2])
    last = rectification.GROWTH ** np.floor(np.log(1e3) / np.log(rectification.GROWTH))
    assert rectification.MOST_ENLARGED / rectification.GROWTH < last <= rectification.MOST_ENLARGED
    for least[0], found in ((LESS * last, True), (MORE * last, False)):
        if found:
            assert rectification._covering(at, 1.0) == pytest.approx(last)
        else:
            with pytest.raises(EstimationError, match="no common area"):
                rectification._covering(at, 1.0)
