"""Points of a calibrated rig: the part of their uncertainty that the calibration brings."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from camcal.assess.covariance import covariance
from camcal.assess.rig import pose_rows
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from camcal.report.rig_loading import load_rig
from camcal.routes.calibration_part import calibration_part
from camcal.routes.placed import PlacedCamera
from camcal.routes.triangulate import sorted_images, triangulate

ROOT = Path(__file__).resolve().parents[2]
POINTS = np.array([[-200.0, -100, 1500], [300, 120, 1800], [100, 50, 1200]])


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    """The report of a simulated pair, calibrated from 15 views with 0.1 px of noise."""
    from camcal.cli.boundary import run

    place = tmp_path_factory.mktemp("rig")
    script = ROOT / "examples" / "stereo_data.py"
    subprocess.run([sys.executable, str(script), str(place)], check=True, env={"PYTHONPATH": str(ROOT)})
    words = [
        "rig",
        place / "boards.csv",
        "--image-size",
        "640x480",
        "-m",
        "opencv4",
        "-o",
        place / "rig.yaml",
    ]
    assert run([*map(str, words), "-q"]) == 0
    return place


def placed(solution, change=None):
    """The cameras, with the variables moved by a step (F,)."""
    step = np.zeros(solution.free.shape[1]) if change is None else change
    out, begin = [], 0
    for name, camera in solution.rig.cameras.items():
        own = slice(begin, begin + camera.lens.size)
        begin = own.stop
        pose, move = solution.rig.cam_from_rig[name], pose_rows(solution, name) @ step
        turned = Pose.from_vector(move[:3], np.zeros(3)).rotation @ pose.rotation
        moved = Camera(camera.lens, camera.params + solution.free[own] @ step, camera.image_size)
        out.append(PlacedCamera(name, moved, Pose(turned, pose.translation + move[3:])))
    return out


def test_the_derivatives_are_those_of_triangulation(rig):
    """The covariance of one variable alone is the square of what a small step of it does to the points."""
    solution = load_rig(rig / "rig.yaml")
    cameras = placed(solution)
    count, variables = len(POINTS), solution.free.shape[1]
    uv = np.concatenate([c.project(POINTS) for c in cameras])
    images, _ = sorted_images(np.repeat([0, 1], count), np.tile(np.arange(count), 2), uv)
    found = triangulate(cameras, images, count)
    sigmas = np.sqrt(np.diag(covariance(solution).free))
    moves = [
        np.concatenate([solution.free[c * 8 : c * 8 + 8], pose_rows(solution, camera.name)])
        for c, camera in enumerate(cameras)
    ]
    for variable in range(variables):
        step = np.zeros(variables)
        step[variable] = 0.1 * sigmas[variable]
        there, back = (triangulate(placed(solution, s * step), images, count).xyz for s in (1, -1))
        one = np.diag((step != 0) * 1.0)
        ours = calibration_part(found, images, moves, one, np.zeros((variables, 0)))
        moved = (there - back) / (2 * step[variable])
        expected = np.einsum("pi,pj->pij", moved, moved)
        # exact images: (1) is to first order in the residuals; the step squared leaves 1e-3
        scale = np.abs(expected).max()
        np.testing.assert_allclose(ours, expected, atol=1e-3 * scale, rtol=0)


def test_a_direction_that_the_calibration_left_open_is_infinite(rig):
    solution = load_rig(rig / "rig.yaml")
    cameras, count = placed(solution), len(POINTS)
    uv = np.concatenate([c.project(POINTS) for c in cameras])
    images, _ = sorted_images(np.repeat([0, 1], count), np.tile(np.arange(count), 2), uv)
    found = triangulate(cameras, images, count)
    moves = [
        np.concatenate([solution.free[c * 8 : c * 8 + 8], pose_rows(solution, camera.name)])
        for c, camera in enumerate(cameras)
    ]
    null = np.eye(solution.free.shape[1])[:, :1]
    part = calibration_part(found, images, moves, covariance(solution).free, null)
    assert np.isinf(part[:, range(3), range(3)]).any(1).all()


def test_the_command_says_both_parts(rig, capsys):
    from camcal.cli.boundary import run

    words = [rig / "rig.yaml", rig / "points.csv", "--format", "json"]
    assert run(["triangulate", *map(str, words)]) == 0
    points = json.loads(capsys.readouterr().out)["points"]
    off = np.array([p["xyz"] for p in points]) - POINTS
    sigma, part = (np.array([p[k] for p in points]) for k in ("sigma", "sigma_calibration"))
    # images to 1/2000 px: the error is the calibration's, and what it leaves as residuals counts as noise of the images
    assert (part > 0.7 * sigma).all() and (np.abs(off) < 4 * sigma).all()
    assert run(["convert", str(rig / "rig.yaml"), str(rig / "pair.yml"), "-q"]) == 0
    capsys.readouterr()
    assert run(["triangulate", str(rig / "pair.yml"), str(rig / "points.csv"), "--format", "json"]) == 0
    alone = json.loads(capsys.readouterr().out)["points"]
    assert all("sigma_calibration" not in p for p in alone)
    assert (np.array([p["sigma"] for p in alone]) < sigma).all()
