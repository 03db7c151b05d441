"""Closed forms of hand and eye beside cv2's, where the wheel has them; what is said where it has not."""

import cv2
import pytest

from camcal.model.pose import Pose
from camcal.peers.hand_eye import METHODS, against_cv2
from camcal.routes.hand_eye import CLOSED_FORMS
from camcal.routes.hand_eye.closed_forms import length_unit, solve_all
from camcal.routes.hand_eye.views import views_of
from tests.routes.hand_eye.hands import hand

SIGMA = (1e-3, 0.8)  # rad and mm, about those of these views


def entries(setup, change=lambda pose: pose):
    h = hand(setup, 6)
    views = views_of(setup, h.robot, h.pictures.poses)
    ours = {m.name: change(m.x) for m in solve_all(views, setup)}
    return against_cv2(views.robot, views.camera, length_unit(views), ours, SIGMA)


def test_every_closed_form_has_its_counterpart():
    assert list(METHODS) == list(CLOSED_FORMS)


@pytest.mark.skipif(not hasattr(cv2, "calibrateHandEye"), reason="this wheel of cv2 has no calibrateHandEye")
@pytest.mark.parametrize("setup", ["in-hand", "to-hand"])
def test_they_agree(setup):
    found = entries(setup)
    assert [e["status"] for e in found] == ["pass"] * 7, [e["why"] for e in found]
    moved = entries(setup, lambda pose: Pose(pose.rotation, pose.translation + [3, 0, 0]))
    assert [e["status"] for e in moved] == ["fail"] * 7


@pytest.mark.skipif(hasattr(cv2, "calibrateHandEye"), reason="this wheel of cv2 has calibrateHandEye")
def test_a_wheel_without_them():
    found = entries("in-hand")
    assert {e["status"] for e in found} == {"not_applicable"}
    assert found[0]["why"] == f"cv2 {cv2.__version__} has no calibrateHandEye"
