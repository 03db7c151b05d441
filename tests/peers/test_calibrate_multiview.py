"""Rigs beside cv2.calibrateMultiview."""

from dataclasses import replace

import cv2
import pytest

from camcal import calibrate_rig
from camcal.peers import calibrate_multiview
from camcal.peers.calibrate_multiview import crosscheck
from camcal.solve.refine import residuals
from tests.rigs import LENS, observed, truth

new = pytest.mark.skipif(not hasattr(cv2, "calibrateMultiview"), reason="OpenCV 5 has it")


@pytest.fixture(scope="module")
def solution():
    data, _ = observed(truth("abc"), instants=8)
    return calibrate_rig(data, model="opencv4", checks=False, crosscheck=False)


@new
def test_cv2_comes_near_and_not_lower(solution):
    entry = crosscheck(solution)
    assert entry["status"] == "pass" and entry["difference"]["rms_point"] < 0, entry
    assert entry["opencv"]["baselines"]["a-b"] == pytest.approx(solution.rig.baseline("a", "b"), rel=0.02)


@new
def test_a_wrong_rig_fails(solution):
    """The check can fail: cameras that are 2 mm off leave cv2 a lower rms."""
    places = {
        n: replace(p, translation=p.translation + (0 if n == "a" else 2))
        for n, p in solution.rig.cam_from_rig.items()
    }
    rig = replace(solution.rig, cam_from_rig=places)
    wrong = replace(solution, rig=rig, residuals=residuals(rig, solution.poses, solution.observations))
    entry = crosscheck(wrong)
    assert entry["status"] == "fail" and "lower rms" in entry["why"], entry


@new
@pytest.mark.parametrize(
    ("model", "why"), [("kb4", "no model like kb4"), ({"a": "opencv4", "": LENS}, "one lens model")]
)
def test_what_it_does_not_take(model, why):
    data, _ = observed(truth("abc"), instants=8)
    found = crosscheck(calibrate_rig(data, model=model, checks=False, crosscheck=False))
    assert found["status"] == "not_applicable" and why in found["why"], found


def test_large_rigs_are_left_out(solution, monkeypatch):
    monkeypatch.setattr(calibrate_multiview, "MOST_CAMERAS", 2)
    assert crosscheck(solution)["status"] == "not_applicable"
