"""Wide lenses against cv2.fisheye and cv2.omnidir, and models that cv2 does not have."""

from dataclasses import replace

import numpy as np
import pytest

from camcal.data.points import read_points
from camcal.errors import DataError
from camcal.geometry import rotations
from camcal.model.camera import Camera
from camcal.model.lenses import make
from camcal.model.pose import Poses
from camcal.peers import find_homography, nearest, omnidir_calibrate, refinement
from camcal.plan.calibrate import calibrate
from tests.shared_data import DATA, needs_data
from tests.solved import grid, observe, rig

SIZE = (1280, 800)


def wide_data(model="kb4", example=0, views=10, noise=0.1, xyz=None, skew=False):
    lens = make(model, skew)
    params, size = lens.examples()[example]
    rng = np.random.default_rng(3)
    xyz = grid() if xyz is None else xyz
    turns = rotations.exp(rng.uniform(-0.5, 0.5, (views, 3)))
    span = np.ptp(xyz, axis=0).max()
    places = np.c_[rng.uniform(-0.3, 0.3, (views, 2)), rng.uniform(0.8, 1.1, views)] * span
    poses = Poses(turns, places - turns @ xyz.mean(0))
    return observe(Camera(lens, params, size), poses, xyz, noise, rng)


def refined(data, model, **options):
    solution = calibrate(data, model, robust="none", checks=False, **options)
    return solution, refinement.against_cv2(solution)


@pytest.mark.parametrize(("model", "skew"), [("kb4", False), ("kb4", True), ("kb:2", False)])
def test_fisheye_reaches_the_same_camera(model, skew):
    # float64 on both sides: the same optimum to rounding
    solution, (made,) = refined(wide_data(skew=skew), model, skew=skew)
    assert (made["status"], made["against"]) == ("pass", "cv2.fisheye.calibrate"), made["why"]
    assert made["opencv"]["rms_point"] == pytest.approx(solution.rms_point, rel=1e-10)
    assert made["difference"]["projection_max_px"] < 1e-4


def test_omnidir_reaches_the_same_camera():
    solution, (made,) = refined(wide_data("mei"), "mei")
    assert (made["status"], made["against"]) == ("pass", "cv2.omnidir.calibrate"), made["why"]
    # cv2 stops at a relative change of its parameters, or after 500 iterations
    assert made["opencv"]["rms_point"] == pytest.approx(solution.rms_point, rel=1e-4)
    assert made["opencv"]["rms_point"] >= solution.rms_point * (1 - 1e-9)


def test_views_that_omnidir_leaves_out_are_left_out_in_both(monkeypatch):
    class Cv2:
        def __getattr__(self, name):
            return getattr(omnidir_calibrate_cv2, name)

        class omnidir:
            def __getattr__(self, name):
                return getattr(omnidir_calibrate_cv2.omnidir, name)

            def calibrate(self, xyz, uv, *rest):
                found = omnidir_calibrate_cv2.omnidir.calibrate(xyz, uv, *rest)
                kept = np.arange(len(xyz)) if len(xyz) < 10 else np.arange(1, 10)
                return (*found[:-1], kept)

        omnidir = omnidir()

    omnidir_calibrate_cv2 = omnidir_calibrate.cv2
    monkeypatch.setattr(omnidir_calibrate, "cv2", Cv2())
    _, (made,) = refined(wide_data("mei"), "mei")
    assert made["status"] == "pass" and "over the 9 views that cv2 keeps" in made["why"]


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"fix": {"k4": 0.01}}, "only at 0"),
        ({"fix": {"fx": 500.0}}, "alone"),
        ({"fix": {"aspect": None}}, "tie"),
    ],
)
def test_what_fisheye_cannot_hold(options, why):
    _, (made,) = refined(wide_data(), "kb4", **options)
    assert made["status"] == "not_applicable" and why in made["why"]


def test_fisheye_takes_boards_only():
    _, (made,) = refined(wide_data(xyz=rig(), views=3), "kb4")
    assert made["status"] == "not_applicable" and "z = 0" in made["why"]


def test_a_model_that_cv2_does_not_have_is_set_beside_its_nearest():
    solution, (made,) = refined(wide_data("eucm"), "eucm")
    assert made["status"] == "not_applicable"
    assert "no counterpart" in made["why"] and "nearest" in made["against"]
    assert made["opencv"]["model"] in nearest.MODELS
    assert made["difference"]["rms_point"] == solution.rms_point - made["opencv"]["rms_point"]
    assert made["difference"]["projection_max_px"] > 0


def test_no_nearest_where_cv2_calibrates_nothing(monkeypatch):
    monkeypatch.setattr(nearest, "_by_cv2", lambda *_: None)
    _, (made,) = refined(wide_data("ds"), "ds")
    assert made["status"] == "not_applicable" and "cannot calibrate these data" in made["why"]


def test_a_camera_by_cv2_of_a_wide_lens():
    from camcal.peers.camera import camera_by_cv2

    solution = calibrate(wide_data(), "kb4", robust="none", checks=False)
    camera, against = camera_by_cv2(solution)
    assert against == "cv2.fisheye.calibrate" and camera.lens == solution.camera.lens
    with pytest.raises(DataError, match="no counterpart"):
        camera_by_cv2(calibrate(wide_data("fov"), "fov", robust="none", checks=False))


@needs_data
def test_real_lenses():
    data = replace(read_points(DATA / "fisheye_jy" / "left.csv"), image_sizes=(SIZE,))
    _, (made,) = refined(data, "kb4")
    assert made["status"] == "pass" and made["difference"]["sigmas"] < 1e-4
    data = replace(read_points(DATA / "ov_plane" / "train.csv"), image_sizes=(SIZE,))
    _, (made,) = refined(data, "kb4")
    assert made["status"] == "not_applicable" and "90 degrees" in made["why"]


@needs_data
def test_homographies_of_a_wide_lens_are_compared_at_their_minimum():
    views = read_points(DATA / "ov_plane" / "train.csv").views
    made = find_homography.against_cv2(views, "zhang")
    assert made["status"] == "pass" and made["opencv"]["rms_point"] > 10
