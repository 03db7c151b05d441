"""Pairs of a rig beside cv2.stereoCalibrate."""

from dataclasses import replace

import pytest

from camcal import calibrate_rig
from camcal.peers.stereo_calibrate import crosscheck
from camcal.solve.refine import How
from tests.rigs import LENS, observed, truth


def solved(names="ab", **more):
    data, _ = observed(truth(names), instants=8)
    options = {"model": "opencv4", "checks": False, "crosscheck": True, **more}
    return calibrate_rig(data, **options)


def test_cv2_finds_the_same_pair():
    (entry,) = solved().crosscheck
    assert entry["against"] == "cv2.stereoCalibrate" and entry["status"] == "pass", entry
    assert abs(entry["difference"]["rms_point"]) < 1e-5
    assert entry["difference"]["sigmas"] < 0.05


def test_every_pair_of_three_cameras():
    entries = solved("abc").crosscheck
    assert [e["status"] for e in entries] == ["pass"] * 3
    assert [e["why"].partition(",")[0].partition(";")[0] for e in entries] == ["a-b", "a-c", "b-c"]


def test_a_wrong_pair_fails():
    """The check can fail: a camera held 1 % off leaves cv2 a lower rms."""
    solution = solved(fix={"a.fx": 610.0, "a.fy": 610.0})
    loose = solved()
    wrong = replace(solution, free=loose.free)
    entries = crosscheck(wrong, None, How({"a.fx": None, "a.fy": None}))
    assert [e["status"] for e in entries] == ["fail"], entries


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"model": "kb4"}, "no model like kb4"),
        ({"model": {"a": "opencv4", "b": LENS}}, "one lens model"),
        ({"fix": {"a.fx": None, "a.fy": None}}, "holds the same parameters"),
    ],
)
def test_what_cv2_does_not_have(options, why):
    (entry,) = solved(**options).crosscheck
    assert entry["status"] == "not_applicable" and why in entry["why"], entry
