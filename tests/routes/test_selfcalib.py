"""Self-calibration: truth and intervals on made scenes, critical motions, wrong tracks, cv2 beside it."""

import csv
import json

import numpy as np
import pytest
from click.testing import CliRunner

from camcal.cli.group import camcal
from camcal.errors import DataError, EstimationError
from camcal.geometry import rotations
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from camcal.peers import two_views
from camcal.routes import epipolar
from camcal.routes.bundle import Tracks
from camcal.routes.selfcalib import estimate

SIZE = (1000, 800)
CAMERA = Camera(lenses.make("opencv4"), np.array([900.0, 900, 510, 392, -0.1, 0.03, 0, 0]), SIZE)
WORLD = np.random.default_rng(0).uniform(-1, 1, (90, 3))


def looking(position, target, roll):
    z = (np.array(target) - position) / np.linalg.norm(np.array(target) - position)
    x = np.cross(z, [0, 0, 1.0])
    x /= np.linalg.norm(x)
    rotation = rotations.exp([0, 0, roll]) @ np.array([x, np.cross(z, x), z])
    return Pose(rotation, -rotation @ position)


def walk(count=7, seed=1):
    rng = np.random.default_rng(seed)
    turn = np.linspace(0, 2.2, count)
    places = np.stack([3.6 * np.cos(turn), 3.6 * np.sin(turn), rng.uniform(-1, 1.4, count)], 1)
    return [
        looking(p, rng.uniform(-0.5, 0.5, 3), r)
        for p, r in zip(places, rng.uniform(-1.5, 1.5, count), strict=True)
    ]


def tracks_of(poses, noise=0.3, seed=0, world=WORLD, camera=CAMERA):
    rng = np.random.default_rng(seed)
    view, point, uv = [], [], []
    for v, pose in enumerate(poses):
        seen = camera.project(pose.apply(world))
        inside = np.isfinite(seen).all(1) & (seen > 0).all(1) & (seen < np.array(SIZE)).all(1)
        for p in np.flatnonzero(inside):
            view.append(v)
            point.append(p)
            uv.append(seen[p] + rng.normal(0, noise, 2))
    return Tracks(np.array(view), np.array(point), np.array(uv))


def solve(tracks, views, fix=None, lens=CAMERA.lens):
    return estimate(tracks, views, len(WORLD), lens, SIZE, fix or {})


def test_the_camera_of_a_walk_with_sigmas_that_hold():
    found = solve(tracks_of(walk()), 7)
    params, sigma = found.bundle.camera.params, np.sqrt(np.diag(found.covariance))
    assert found.bundle.known_views.all() and found.used.mean() > 0.97 and found.assumed == ()
    assert (np.abs(params - CAMERA.params) < 3.5 * sigma)[[0, 2, 3, 4]].all(), (params, sigma)
    assert sigma[0] < 10


def test_poses_and_points_up_to_a_similarity():
    poses = walk()
    found = solve(tracks_of(poses, 0.05), 7)
    ours = found.bundle
    for a, b in ((0, 3), (2, 6)):
        turn = poses[a].rotation @ poses[b].rotation.T
        assert np.degrees(rotations.angle_between(ours.rotations[a] @ ours.rotations[b].T, turn)) < 0.2
    known = ours.known_points
    ratio = np.linalg.norm(np.diff(ours.points[known], axis=0), axis=1) / np.linalg.norm(
        np.diff(WORLD[known], axis=0), axis=1
    )
    assert ratio.std() / ratio.mean() < 0.01


def test_wrong_tracks_are_left_out():
    tracks = tracks_of(walk())
    wrong = np.random.default_rng(2).choice(len(tracks), len(tracks) // 20, replace=False)
    tracks.uv[wrong] += np.random.default_rng(3).uniform(15, 40, (len(wrong), 2))
    found = solve(tracks, 7)
    assert (~found.used[wrong]).mean() > 0.9
    assert abs(found.bundle.camera.params[0] / 900 - 1) < 0.02


def test_a_known_focal_length_is_held():
    found = solve(tracks_of(walk(3)), 3, {"fx": 900.0, "cx": 510.0, "cy": 392.0})
    assert found.bundle.camera.params[0] == 900
    assert {"fx", "cx", "cy"} <= set(found.fixed)


def test_critical_motions_are_refused_by_name():
    toward = [looking(p, (0, 0, 0), 0.0) for p in ((3.5, 0.0, 0.3), (3.0, 1.8, 0.3))]
    with pytest.raises(EstimationError, match="critical"):
        solve(tracks_of(toward), 2)
    forward = [Pose(toward[0].rotation, toward[0].translation + [0.02 * i, 0, -0.15 * i]) for i in range(5)]
    with pytest.raises(EstimationError, match="critical"):
        solve(tracks_of(forward, 0.5), 5)
    with pytest.raises(DataError, match="16 points"):
        estimate(tracks_of(walk(3)).take(np.arange(12)), 3, len(WORLD), CAMERA.lens, SIZE, {})


@pytest.mark.parametrize("seed", [0, 1])
def test_a_rotation_alone_is_refused_or_right(seed):
    """It determines the focal length, but no depths to put views together with."""
    first = looking((3.5, 0.0, 0.3), (0, 0, 0), 0.0)
    turns = [rotations.exp([0.05 * i, 0.08 * i, 0.1 * i]) for i in range(4)]
    turned = [Pose(t @ first.rotation, t @ first.translation) for t in turns]
    try:
        found = solve(tracks_of(turned, seed=seed), 4)
    except EstimationError as error:
        assert "critical" in error.message
    else:
        assert abs(found.bundle.camera.params[0] - 900) < 4 * np.sqrt(found.covariance[0, 0])


def test_fundamental_matrix_and_motion_beside_cv2():
    poses = walk(3)
    pinhole = Camera(lenses.make("pinhole"), CAMERA.params[:4], SIZE)
    first, second = (pinhole.project(p.apply(WORLD)) for p in (poses[0], poses[2]))
    rng = np.random.default_rng(4)
    noisy = first + rng.normal(0, 0.3, first.shape), second + rng.normal(0, 0.3, second.shape)
    matrix, good = epipolar.fundamental(*noisy)
    assert good.mean() > 0.95
    assert two_views.fundamental(noisy[0][good], noisy[1][good], matrix)["status"] == "pass"
    assert two_views.fundamental(noisy[0][good], noisy[1][good], np.diag([1.0, 2, 3]))["status"] == "fail"
    truth = poses[2] @ poses[0].inverse()
    assert two_views.motion(pinhole, *noisy, truth)["status"] == "pass"
    other = Pose(rotations.exp([0.1, 0, 0]) @ truth.rotation, truth.translation)
    assert two_views.motion(pinhole, *noisy, other)["status"] == "fail"
    wrong = noisy[1].copy()
    wrong[:27] += 60
    assert not epipolar.fundamental(noisy[0], wrong)[1][:27].any()


def test_the_command(tmp_path):
    tracks = tracks_of(walk(4))
    with (tmp_path / "tracks.csv").open("w", newline="") as handle:
        rows = [
            [f"v{v}", p, *uv] for v, p, uv in zip(tracks.view, tracks.point, tracks.uv.tolist(), strict=True)
        ]
        csv.writer(handle).writerows([["view", "point", "u", "v"], *rows, rows[0]])
    args = ["selfcalib", str(tmp_path / "tracks.csv"), "--image-size", "1000x800", "-q", "--format", "json"]
    done = CliRunner().invoke(camcal, args, standalone_mode=False)
    assert done.exception is None, done.output
    report = json.loads(done.output)
    assert [e["status"] for e in report["crosscheck"]] == ["pass", "pass"]
    assert "points-twice" in [w["code"] for w in report["warnings"]]
    assert abs(report["camera"]["parameters"]["fx"]["value"] / 900 - 1) < 0.05
