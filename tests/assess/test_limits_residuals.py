"""Numbers by which residuals are grouped, pictures named and cameras compared, each just below and just above."""

from types import SimpleNamespace

import numpy as np
import pytest

from camcal.assess import bias, comparison, difference, next_instant
from camcal.assess.checks import group, noise, pictures
from camcal.geometry import rotations
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Poses
from tests.sides import LESS, MORE


def moment(monkeypatch, counts, lengths):
    """The fourth moment of views of so many points, each with one length, and its deviation from 2."""
    data = SimpleNamespace(used=None, per_block=lambda _: np.array(counts))
    monkeypatch.setattr(noise, "standard_lengths", lambda _: np.repeat(lengths, counts))
    return noise.fourth_moment(SimpleNamespace(solution=SimpleNamespace(observations=data)))


def test_views_that_are_scaled_by_themselves(monkeypatch):
    """Half of the views are ten times as noisy, which counts only where all are scaled jointly."""
    lengths = [1.0, 10.0] * 3
    assert moment(monkeypatch, [12] * 6, lengths)[0] == pytest.approx(13 / 12)
    joint = 0.5 * (1 + 100**2) / 50.5**2
    assert moment(monkeypatch, [11] * 6, lengths)[0] == pytest.approx(joint * 67 / 66)


@pytest.mark.parametrize(("small", "points"), [(6, 72), (5, 60)])
def test_views_that_are_scaled_jointly(monkeypatch, small, points):
    """They count where there are as many points of them in all as of one that is scaled by itself."""
    found, deviations = moment(monkeypatch, [12] * 5 + [6, small], np.ones(7))
    assert found == pytest.approx(13 / 12) and deviations == pytest.approx((found - 2) * np.sqrt(points) / 2)


@pytest.mark.parametrize("share", [LESS, MORE])
def test_what_is_left_of_a_point_s_noise(share):
    """In its residual along u; a thousandth at least is taken for it."""
    design = SimpleNamespace(hat=lambda _: np.diag([1 - share * 1e-3, 0.0])[None], sigma_0=1.0)
    z, _ = bias._whitened(design, SimpleNamespace(residuals=np.ones((1, 2))))
    assert z[0] == pytest.approx([(max(share, 1) * 1e-3) ** -0.5, 1.0], rel=1e-9)


def test_sectors_of_directions(monkeypatch):
    """Twelve, of two directions each where there are 24."""
    groups = {}
    made = SimpleNamespace(name=None)
    monkeypatch.setattr(bias, "_means", lambda name, _, __, group, *___: groups.update({name: group}) or made)
    for name in ("_correlation", "_gaussian"):
        monkeypatch.setattr(bias, name, lambda _: made)
    monkeypatch.setattr(bias, "holm", list)
    turn = (np.arange(24) + 0.5) * (np.pi / 12)
    offset = 100 * np.c_[np.cos(turn), np.sin(turn)]
    zero = np.zeros((24, 2))
    bias.residual_tests(
        SimpleNamespace(offset=offset, z=zero, on_board=zero, point=np.zeros(24, int), view=np.zeros(24, int))
    )
    assert np.bincount(groups["angle"]).tolist() == [2] * 12


@pytest.mark.parametrize(
    ("count", "said"), [(3, "p0 (x), p1 (x), p2 (x)."), (4, "p0 (x), p1 (x), p2 (x), ...")]
)
def test_pictures_that_are_named(count, said):
    names = [f"p{i}" for i in range(count)]
    data = SimpleNamespace(
        views=[SimpleNamespace(id=name) for name in names],
        picture_quality={name: {"warnings": ["blurred: x"]} for name in names},
    )
    ((_, message, share),) = pictures.faults(data)
    assert message == f"blurred in {count} of {count} pictures: {said}" and share == 1


@pytest.mark.parametrize(("share", "moved"), [(LESS, False), (MORE, True)])
def test_shifts_that_a_fit_follows(share, moved):
    """By the smaller eigenvalue of what the fit leaves of a point's shift."""
    rows = SimpleNamespace(roots=np.ones(1), residuals=np.ones((1, 2)))
    left = np.diag([share * 1e-9, 1.0]).reshape(1, 2, 1, 2)
    squares, shift = group._of_shift(rows, left, np.array([0]))
    assert (squares > 0) == shift.any() == moved


# ------------------------------------------------------------------------------------ comparisons
@pytest.mark.parametrize("share", [LESS, MORE])
def test_the_least_uncertainty_that_weighs_a_pixel(monkeypatch, share):
    sigma = share * 1e-9
    uncertainty = SimpleNamespace(
        at_pixels=lambda pixels, _: np.tile(sigma**2 * np.eye(2), (len(pixels), 1, 1))
    )
    side = SimpleNamespace(
        camera=None, uncertainty=uncertainty, has_data=lambda pixels: np.ones(len(pixels), bool)
    )
    weights = []

    def apart(_, __, pixels, ___, given):
        weights.extend(given)
        return SimpleNamespace(vectors=np.zeros((len(pixels), 2)))

    monkeypatch.setattr(comparison, "difference", apart)
    other = SimpleNamespace(camera=None, uncertainty=None, has_data=side.has_data)
    comparison.compare(side, other, (np.zeros(2), np.full(2, 99.0)))
    assert weights == pytest.approx([1e18 / max(share, 1) ** 2] * len(weights)) and len(weights) == 1600


@pytest.mark.parametrize("share", [0.0, 0.9, 1.1])
def test_pictures_that_are_one_pixel_wide(share):
    """Their width is taken for a px: a grid of square cells over them would have no end."""
    grid = difference.image_grid(np.zeros(2), np.array([share, 99.0]), columns=40)
    assert len(grid) == 40 * round(40 * 99 / max(share, 1.0)) and np.ptp(grid, axis=0).tolist() == [
        share,
        99.0,
    ]


def test_a_point_outside_the_domain_of_a_camera():
    """It costs more than any that is inside the picture: a thousand px in each coordinate."""
    camera = Camera(lenses.make("pinhole"), np.array([800.0, 800, 500, 400]), (1000, 800))
    points = np.array([[0.0, 0, 1], [0.0, 0, -1]])
    problem = difference._Alignment(camera, points, np.array([[500.0, 400]] * 2), np.ones(2), False)
    normal = problem.linearise(difference._Placed(np.eye(3)[None], np.zeros((1, 3))), np.zeros(1, int))
    assert normal.cost[0] == pytest.approx(1000.0**2)


# ------------------------------------------------------------------------------------ next instants
def test_turns_of_a_rig_that_are_tried():
    """Sixty, by up to half a rad about each axis."""
    poses = Poses(np.tile(np.eye(3), (3, 1, 1)), np.zeros((3, 3)))
    found = next_instant._turned(SimpleNamespace(poses=poses), np.random.default_rng(0))
    largest = np.abs(rotations.log(found.rotations)).max()
    assert len(found) == 60 and 0.48 < largest < 0.5
