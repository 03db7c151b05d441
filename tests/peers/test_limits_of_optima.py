"""How long cv2 may search, and when both have found one optimum: numbers just below and just above."""

from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from camcal.geometry import homography, rotations
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose, Poses
from camcal.peers import (
    base,
    calibrate_camera,
    calibrate_multiview,
    find_homography,
    omnidir_calibrate,
    refinement,
    solve_pnp,
    stereo_calibrate,
    triangulate_points,
    undistort_points,
)
from camcal.solve.refine import How, refine
from tests.sides import LESS, MORE
from tests.solved import grid, observe, solved

CAMERA = Camera(
    lenses.make("opencv5"), np.array([500.0, 500, 319.5, 239.5, -0.35, 0.12, 0, 0, -0.02]), (640, 480)
)


@pytest.fixture(scope="module")
def good():
    return solved("opencv5", views=5, noise=0.2)


# ------------------------------------------------------------------------------------ searches of cv2
def rms(good, iterations, guess=None):
    task = calibrate_camera.task_of(good)
    return calibrate_camera.run(replace(task, iterations=iterations), guess).rms_point


def test_iterations_of_cv2(good):
    """By itself it is done before them; three are not enough."""
    usual = rms(good, base.MOST_ITERATIONS)
    assert abs(rms(good, 2 * base.MOST_ITERATIONS) - usual) < 1e-3 * base.LOWER_PX
    assert usual < good.rms_point + base.LOWER_PX
    assert rms(good, 3) > good.rms_point * (1 + base.SAME) + base.LOWER_PX


def test_iterations_that_show_whether_cv2_stays(good):
    """A camera that is off by 2 % is left by them, to the optimum; by two fewer only in its direction."""
    off = replace(good.camera, params=good.camera.params * 1.02)
    for iterations, there in ((base.TO_STAY, True), (base.TO_STAY - 2, False)):
        result = SimpleNamespace(rms_point=rms(good, iterations, off), rounded=False)
        assert refinement._same(result, good) == there


@pytest.mark.parametrize(("gain", "there"), [(calibrate_camera.STILL, True), (1e-2, False)])
def test_changes_at_which_cv2_stops(good, monkeypatch, gain, there):
    usual = calibrate_camera.criteria
    monkeypatch.setattr(calibrate_camera, "criteria", lambda iterations: usual(iterations, gain))
    assert (rms(good, base.MOST_ITERATIONS) < good.rms_point + base.LOWER_PX) == there


def wide_views(model, views, near, tilt):
    """Of a wide lens before a board: the solution from the truth."""
    lens, rng = lenses.make(model), np.random.default_rng(3)
    params, size = lens.examples()[0]
    xyz, turns = grid(), rotations.exp(rng.uniform(-tilt, tilt, (views, 3)))
    places = 9 * np.c_[rng.uniform(-0.2, 0.2, (views, 2)), np.full(views, near)]
    poses = Poses(turns, places - turns @ xyz.mean(0))
    camera = Camera(lens, params, size)
    return refine(camera, poses, observe(camera, poses, xyz, 0.1, rng), How())


@pytest.mark.skipif(not hasattr(cv2, "omnidir"), reason="without the contributed modules")
def test_changes_at_which_omnidir_stops(monkeypatch):
    """Its first thirty iterations are all made, as with a hundredth; larger changes are taken for an end."""
    task = replace(calibrate_camera.task_of(wide_views("mei", 3, 0.8, 0.5)), iterations=30)
    found, enough = [], omnidir_calibrate._ENOUGH
    for factor in (1.0, 0.01, 1e8):
        monkeypatch.setattr(omnidir_calibrate, "_ENOUGH", factor * enough)
        found.append(omnidir_calibrate.run(task, None).rms_point)
    usual, finer, coarser = found
    assert usual == pytest.approx(finer, rel=1e-9) and coarser > 1.05 * usual


@pytest.mark.parametrize(
    ("count", "change", "status"),
    [
        (undistort_points.STOP[1], undistort_points.STOP[2], "pass"),
        (2 * undistort_points.STOP[1], undistort_points.STOP[2] / 2, "pass"),
        (undistort_points.STOP[1] // 25, undistort_points.STOP[2], "fail"),
        (undistort_points.STOP[1], 1e8 * undistort_points.STOP[2], "fail"),
    ],
)
def test_iterations_of_undistorted_points(monkeypatch, count, change, status):
    uv = np.random.default_rng(0).uniform((0, 0), (640, 480), (50, 2))
    monkeypatch.setattr(undistort_points, "STOP", (undistort_points.STOP[0], count, change))
    assert undistort_points.against_cv2("refine", CAMERA, uv)["status"] == status


def test_steps_of_the_homography_of_a_wide_lens():
    """Of a fisheye before a board that fills it: half of the steps leave more than what is allowed."""
    views = wide_views("kb4", 10, 0.25, 0.9).observations.views
    plane = np.array([v.xyz[:, :2] for v in views])
    uv = np.array([v.uv for v in views])
    few, usual, end = (
        homography.transfer(homography.solve(plane, uv, steps=n)[0], plane)
        for n in (find_homography.STEPS // 2, find_homography.STEPS, 4 * find_homography.STEPS)
    )
    allowed = find_homography.PART * np.sqrt(np.square(end - uv).sum(2).mean(1))
    off = [(np.linalg.norm(found - end, axis=2).max(1) / allowed).max() for found in (usual, few)]
    assert off[0] < 0.1 and off[1] > 1


# ------------------------------------------------------------------------------------ one optimum
def judged(good, rms_point):
    result = base.Result(good.camera, good.poses, rms_point, np.zeros(5), "there", rounded=False)
    return refinement._judged(good, result, "cv2.calibrateCamera", [])


@pytest.mark.parametrize("name", ["LOWER", "LOWER_PX"])
@pytest.mark.parametrize(("share", "status"), [(LESS, "pass"), (MORE, "fail")])
def test_an_rms_of_cv2_that_is_lower(good, monkeypatch, name, share, status):
    """Each of the two limits without the other."""
    limit = getattr(base, name) * (good.rms_point if name == "LOWER" else 1.0)
    for module in (refinement, stereo_calibrate, calibrate_multiview):
        monkeypatch.setattr(module, {"LOWER": "LOWER_PX", "LOWER_PX": "LOWER"}[name], 0.0)
    assert judged(good, good.rms_point - share * limit)["status"] == status


@pytest.mark.parametrize(("share", "higher"), [(LESS, False), (MORE, True)])
def test_an_rms_of_cv2_that_is_higher(good, share, higher):
    more = base.SAME * good.rms_point + base.LOWER_PX
    assert ("higher rms" in judged(good, good.rms_point + share * more)["why"]) == higher


@pytest.mark.parametrize(("share", "status"), [(LESS, "pass"), (MORE, "fail")])
def test_a_pose_that_is_worse(monkeypatch, share, status):
    """Than cv2's, by the rms of its residuals."""
    theirs = 0.3
    ours = theirs + share * (base.SAME * theirs + base.LOWER_PX)
    xyz = np.random.default_rng(0).uniform(-1, 1, (9, 3))
    pose = Pose(np.eye(3), np.array([0.0, 0, 6]))
    monkeypatch.setattr(solve_pnp, "_rms", lambda _, p, *__: ours if p is pose else theirs)
    camera = Camera(lenses.make("pinhole"), np.array([500.0, 500, 319.5, 239.5]), (640, 480))
    assert solve_pnp.against_cv2(camera, xyz, camera.project(pose.apply(xyz)), pose)["status"] == status


@pytest.mark.parametrize(("share", "status"), [(LESS, "pass"), (MORE, "fail")])
def test_triangulated_points_that_are_worse(monkeypatch, share, status):
    theirs = 0.3
    ours = theirs + share * (base.SAME * theirs + base.LOWER_PX)
    xyz = np.random.default_rng(0).uniform(-1, 1, (9, 3)) + [0, 0, 6.0]
    camera = Camera(lenses.make("pinhole"), np.array([500.0, 500, 319.5, 239.5]), (640, 480))
    seen = [
        (camera, p, camera.project(p.apply(xyz)))
        for p in (Pose.identity(), Pose(np.eye(3), np.array([1.0, 0, 0])))
    ]
    monkeypatch.setattr(triangulate_points, "_errors", lambda *_: (np.full(9, theirs), np.full(9, ours)))
    assert triangulate_points.against_cv2(*seen, xyz)["status"] == status
