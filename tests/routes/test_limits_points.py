"""Numbers by which the routes treat points and a robot's poses, each just below and just above."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2

from camcal.data.observations import View
from camcal.errors import EstimationError
from camcal.geometry import rotations
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Poses
from camcal.routes import calibration_part, distortion_first, triangulate
from camcal.routes.hand_eye import agreement, next_pose, scale, variance
from camcal.routes.hand_eye.views import Views
from tests.sides import LESS, MORE

SIZE = (1000, 800)
PINHOLE = Camera(lenses.make("pinhole"), np.array([800.0, 800, 500, 400]), SIZE)


class Stack(SimpleNamespace):
    def __len__(self):
        return self.count


# ------------------------------------------------------------------------------------ points
def test_images_of_points_that_are_left_out(monkeypatch):
    """A point of two residuals too many; and one of a few images is tested at all."""
    count = 4
    images = SimpleNamespace(point=np.zeros(count, int))
    monkeypatch.setattr(triangulate, "_scale", lambda *_: 1.0)
    monkeypatch.setattr(triangulate, "_solve", lambda *_: None)

    def left_out(cost, freedom, left=0.0):
        costs = iter(
            [(np.array([cost]), np.array([freedom]))] + [(np.array([left]), np.array([freedom - 2]))] * 9
        )
        monkeypatch.setattr(triangulate, "_costs", lambda *_: next(costs))
        return not triangulate._without_outliers([], images, np.ones(count, bool), None, 1).all()

    quantile = triangulate.chi2_quantile
    limit, rest = (float(quantile(triangulate.LEVEL, np.array(n))) for n in (5, 3))
    assert left_out(MORE * limit, 5) and not left_out(LESS * limit, 5)
    assert left_out(2 * limit, 5, LESS * rest) and not left_out(2 * limit, 5, MORE * rest)
    least = triangulate.LEAST_FREEDOM
    assert left_out(1e9, least) and not left_out(1e9, least - 1)


def test_points_that_move_with_an_undetermined_direction(monkeypatch):
    placed = SimpleNamespace(
        cameras=[None], xyz=np.zeros((1, 3)), used=np.ones(3, bool), known=np.ones(1, bool)
    )
    images = Stack(camera=np.zeros(3, int), point=np.zeros(3, int), sigma=None, count=3)
    moves = np.zeros((3, 2, 2))
    moves[:, 0, 0] = 1.0
    by_point = np.stack([np.eye(3)[:2], np.eye(3)[1:], np.eye(3)[[2, 0]]])
    monkeypatch.setattr(calibration_part, "_derivatives", lambda *_: (by_point, moves))
    for share, lost in ((LESS, False), (MORE, True)):
        null = np.array([[share * calibration_part.TOUCHED], [1.0]])
        found = calibration_part.calibration_part(placed, images, [None], np.eye(2), null)
        assert np.isinf(found).any() == lost


def test_a_map_at_another_focal_length(monkeypatch):
    for share, kept in ((LESS, True), (MORE, False)):
        made = SimpleNamespace(
            errors=np.array([share * distortion_first.EXACT]), covered=np.ones(1, bool), params=PINHOLE.params
        )
        monkeypatch.setattr(distortion_first, "regress", lambda *_, m=made: m)
        if kept:
            assert distortion_first.at_focal_length(PINHOLE, 500.0).params is PINHOLE.params
        else:
            with pytest.raises(EstimationError, match="cannot represent this distortion"):
                distortion_first.at_focal_length(PINHOLE, 500.0)


# ------------------------------------------------------------------------------------ hand-eye
@pytest.mark.parametrize(("column", "size"), [(0, 1.0), (3, 1.0), (3, LESS * agreement.ROUNDING)])
def test_poses_that_agree(monkeypatch, column, size):
    """All but one pose leave residuals of one size, in robust standard deviations; the least size is rounding."""
    monkeypatch.setattr(agreement.shah, "rotations_of", lambda *_: (None, None))
    monkeypatch.setattr(agreement, "from_rotations", lambda *_: (None, None))
    for count in (agreement.LEAST, agreement.LEAST - 1):
        poses = SimpleNamespace(rotation=np.zeros((count, 3, 3)), translation=np.zeros((count, 3)))
        views = Stack(robot=poses, camera=poses, robot_poses=lambda _: None, count=count)
        for share in (LESS, MORE):
            off = np.zeros((agreement.SAMPLES, count, 6))
            off[..., [0, 3]] = size * np.sqrt(chi2.median(3))
            off[:, 0, column] = share * agreement.FAR * max(size, agreement.ROUNDING)
            monkeypatch.setattr(agreement.equation, "residuals", lambda *_, o=off: o)
            kept = share == LESS or count < agreement.LEAST
            assert agreement.agreeing(views, "in-hand")[0] == kept


def test_views_of_the_board_that_are_suggested(monkeypatch):
    """The board is seen at an angle to its plane."""
    monkeypatch.setattr(next_pose, "TURNS", [(0.0, 0.0, 0.0)])
    xyz = np.array([[-0.1, -0.1, 0], [0.1, -0.1, 0], [0.1, 0.1, 0], [-0.1, 0.1, 0]])
    view = View("a", xyz, np.full((4, 2), 500.0))
    for share, seen in ((LESS, False), (MORE, True)):
        tilt = np.pi / 2 - share * next_pose.FLATTEST
        poses = Poses(rotations.exp(np.array([[tilt, 0, 0]])), np.array([[0.0, 0, 5]]))
        pictures = SimpleNamespace(views=[view], seen=SimpleNamespace(camera=[0]), camera=PINHOLE)
        found = next_pose._candidates(SimpleNamespace(pictures=pictures, poses=poses))[0]
        assert bool(len(found)) == seen


def test_motions_that_determine_a_scale():
    """Three coordinates of each motion but one, less the four unknowns."""
    rng = np.random.default_rng(0)
    for count, known in ((3, True), (2, False)):  # 3 (V - 1) - 4 is 2 and -1
        turn = rotations.exp(rng.normal(size=(count, 3)))
        stack = Poses(turn, rng.normal(size=(count, 3)))

        assert np.isfinite(scale.scale(Views(stack, stack))[0]) == known


def test_the_least_variances_of_a_robot():
    model = variance._Model.__new__(variance._Model)
    for name, value in (("k", np.eye(6)[None]), ("left", 4.0), ("freedom", 2.0)):
        object.__setattr__(model, name, value)
    floors = np.exp(model.floors(SimpleNamespace(image=3.0)))
    assert floors == pytest.approx([2e-6, 9 * variance.FLOOR, 9 * variance.FLOOR])
