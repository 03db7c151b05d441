"""Self-calibration: truth and intervals on made scenes, critical motions, wrong tracks, cv2 beside it."""

import csv
import dataclasses
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
from camcal.routes import dual_quadric, epipolar, lifted, selfcalib
from camcal.routes.bundle import Bundle, Tracks, adjust, camera_covariance
from camcal.routes.reconstruct import pairs
from camcal.routes.selfcalib import UNCERTAIN, estimate
from camcal.solve.parameters import free_matrix

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


def test_what_a_critical_motion_leaves_undetermined_has_large_variances():
    """Translations alone: normal equations have eigenvalues of 0, which rounding may make negative."""
    first = looking((3.5, 0.0, 0.3), (0, 0, 0), 0.0)
    moved = [Pose(first.rotation, first.translation + [0.3 * i, 0.1 * i, 0.05 * i]) for i in range(5)]
    tracks = tracks_of(moved, 0.0)
    bundle = Bundle(
        CAMERA, np.stack([p.rotation for p in moved]), np.stack([p.translation for p in moved]), WORLD
    )
    free = free_matrix(CAMERA.lens, CAMERA.params, {"aspect": None})
    exact = camera_covariance(adjust(bundle, tracks, free), tracks, free)
    tracks = tracks_of(moved, 0.3)
    noisy = camera_covariance(adjust(bundle, tracks, free), tracks, free)
    for found in (exact, noisy):
        assert (np.diagonal(found) >= 0).all()
    assert np.sqrt(noisy[0, 0]) > UNCERTAIN * CAMERA.params[0]  # refused


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


def bent_tracks(count, coefficient=-0.6, noise=0.3, wrong=0.0):
    """Images through a lens that bends far (corners of the picture are seen at 60 degrees and more)."""
    rng = np.random.default_rng(5)
    camera = Camera(lenses.make("division:1"), np.array([600.0, 600, 499.5, 399.5, coefficient]), SIZE)
    tracks = tracks_of(walk()[:count], noise, 0, rng.uniform(-1.3, 1.3, (300, 3)), camera)
    uv = tracks.uv.copy()
    off = (rng.random(len(uv)) < wrong) & (tracks.view == count - 1)
    uv[off] = rng.uniform([0, 0], SIZE, (int(off.sum()), 2))
    return camera, Tracks(tracks.view, tracks.point, uv)


@pytest.mark.parametrize(("wrong", "most"), [(0.0, 0.05), (0.3, 0.1)])
def test_rational_rays_from_two_views_of_unknown_points(wrong, most):
    camera, tracks = bent_tracks(2, wrong=wrong)
    index = [
        dict(zip(tracks.point[tracks.view == v].tolist(), tracks.uv[tracks.view == v], strict=True))
        for v in (0, 1)
    ]
    shared = sorted(index[0].keys() & index[1].keys())
    found = lifted.of_matches([tuple(np.array([i[p] for p in shared]) for i in index)], SIZE)
    assert found.kind in ("division", "rational")
    truth = camera.params[4] * np.sum(np.square(SIZE)) / 4 / 600**2  # in half diagonals
    assert np.allclose(found.rays[2, [0, 2]], truth, rtol=most)


def test_a_lens_without_distortion_stays_a_pinhole_camera():
    tracks = bent_tracks(2, coefficient=0.0)[1]
    first, second = (tracks.uv[tracks.view == v] for v in (0, 1))
    shared = np.intersect1d(tracks.point[tracks.view == 0], tracks.point[tracks.view == 1])
    pair = [uv[np.isin(tracks.point[tracks.view == v], shared)] for v, uv in enumerate((first, second))]
    assert lifted.of_matches([tuple(pair)], SIZE).kind == "pinhole"


def test_a_lens_that_bends_far_is_calibrated_from_three_views():
    camera, tracks = bent_tracks(3)
    found = estimate(tracks, 3, 300, camera.lens, SIZE, {})
    sigmas = np.sqrt(np.diagonal(found.covariance))
    assert found.rays != "pinhole" and found.used.mean() > 0.95
    assert (
        np.abs(found.bundle.camera.params - camera.params)[[0, 2, 3, 4]] <= 4 * sigmas[[0, 2, 3, 4]]
    ).all()


def test_kruppa_gives_the_focal_length_of_exact_pairs_and_none_of_critical_ones():
    centre = np.array([499.5, 399.5])
    k = np.array([[700.0, 0, centre[0]], [0, 700, centre[1]], [0, 0, 1]])
    poses = walk()
    matrices = [_fundamental(k, poses[i + 1] @ poses[i].inverse()) for i in range(5)]
    assert np.allclose(epipolar.kruppa(np.stack(matrices), centre, 1000.0), 700, rtol=1e-6)
    bent = (
        np.linalg.inv(k).T @ np.diag([1.0, 0.3, 0]) @ np.linalg.inv(k)
    )  # no essential matrix has such values
    found = epipolar.kruppa(bent[None], centre, 1000.0)
    assert not np.allclose(found, 700)


def _fundamental(k, motion):
    t = motion.translation
    cross = np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]])
    return np.linalg.inv(k).T @ cross @ motion.rotation @ np.linalg.inv(k)


def test_sigmas_of_two_views_hold():
    """Good images are not left out for lying beside where a point was when the cameras were others."""
    off, left = [], []
    for seed in range(16):
        tracks = tracks_of(walk(3, 6)[::2], 0.3, seed)
        found = solve(tracks, 2, {"cx": 510.0, "cy": 392.0, "k1": -0.1, "k2": 0.03, "p1": 0.0, "p2": 0.0})
        off.append((found.bundle.camera.params[0] - 900) / np.sqrt(found.covariance[0, 0]))
        left.append(np.mean(~found.used))
    assert np.mean(left) < 0.02 and 0.5 < np.sqrt(np.mean(np.square(off))) < 1.5


def test_tracks_that_stand_still_in_one_view_are_refused():
    uv = np.random.default_rng(0).uniform(0, 800, (60, 2))
    tracks = Tracks(np.repeat([0, 1], 60), np.tile(np.arange(60), 2), np.r_[uv, np.full((60, 2), 5.0)])
    with pytest.raises(EstimationError, match="critical"):
        estimate(tracks, 2, 60, CAMERA.lens, SIZE, {})


def _at(position, target=(0, 0, 0), roll=0.0):
    return looking(np.array(position), target, roll)


def _projective(poses, seed=0):
    """Cameras about the principal point in units of the width, in a random projective frame."""
    k = np.diag([0.7, 0.7, 1.0])
    cameras = np.stack([k @ np.c_[p.rotation, p.translation] for p in poses])
    return cameras @ (np.eye(4) + 0.3 * np.random.default_rng(seed).normal(size=(4, 4)))


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("count", [3, 6])
def test_the_dual_quadric_gives_the_focal_length_of_exact_cameras(count, seed):
    assert np.isclose(dual_quadric.constant(_projective(walk(count, seed), seed)), 0.7, rtol=1e-6)


def test_the_dual_quadric_is_of_a_turntable_where_single_pairs_are_critical():
    poses = [_at((3.5 * np.cos(a), 3.5 * np.sin(a), 0.8 * a - 0.5), roll=0.6 * a) for a in (0, 0.6, 1.3, 2.0)]
    camera = Camera(lenses.make("pinhole"), np.array([900.0, 900, 499.5, 399.5]), SIZE)
    tracks = tracks_of(poses, 0.3, camera=camera)
    known = pairs(tracks, 4)
    assert all(epipolar.axes_apart(p.matrix, np.array([499.5, 399.5])) < 10 for p in known)
    assert abs(dual_quadric.focal(known, tracks, SIZE) / 900 - 1) < 0.05
    two = np.flatnonzero(tracks.view < 2)
    assert dual_quadric.focal(pairs(tracks.take(two), 2), tracks.take(two), SIZE) is None


def test_the_dual_quadric_of_cameras_that_only_turn_is_none():
    """All cameras are at one place: f² of noise is negative or outside what is looked for, or F says so before."""
    rng = np.random.default_rng(0)
    cameras = rng.normal(size=(4, 3, 4))
    found = dual_quadric.constant(cameras)
    assert found is None or 0.26 <= found <= 6.0


def test_right_images_are_kept_and_wrong_ones_are_not():
    """Three views leave residuals of very different size: none of noise is left out, one of ten deviations is."""
    poses = walk(3, 4)
    camera = Camera(lenses.make("pinhole"), np.array([900.0, 900, 499.5, 399.5]), SIZE)
    left = []
    for seed in range(6):
        tracks = tracks_of(poses, 0.3, seed, camera=camera)
        wrong = int(np.flatnonzero(tracks.view == 1)[seed])
        uv = tracks.uv.copy()
        uv[wrong] += 3.0
        found = solve(Tracks(tracks.view, tracks.point, uv), 3, {}, camera.lens)
        point = tracks.point == tracks.point[wrong]
        assert not found.used[point].all()
        left.append(int((~found.used[~point]).sum()))
    assert sum(left) <= 1


@pytest.mark.parametrize("seed", [453, 517])
def test_the_dual_quadric_of_noise_warns_of_no_overflow(seed):
    found = dual_quadric.constant(np.random.default_rng(seed).normal(size=(4, 3, 4)))
    assert found is None or 0.26 <= found <= 6.0


@pytest.mark.parametrize("way", ["raises", "places nothing"])
def test_a_start_that_fails_gives_way_to_the_next(monkeypatch, way):
    """Both focal lengths are nearly the same; from the first, the views cannot be put together."""
    tracks, tried = tracks_of(walk(5)), []
    put_together = selfcalib._put_together

    def first_fails(known, start, *rest):
        tried.append(start)
        made = put_together(known, start, *rest)
        if len(tried) > 1:
            return made
        if way == "raises":
            raise EstimationError("the views differ by a rotation alone.")
        return dataclasses.replace(made, points=np.full_like(made.points, np.nan))

    monkeypatch.setattr(selfcalib, "_put_together", first_fails)
    found = solve(tracks, 5)
    assert len(tried) == 2 and found.start is tried[1]
    assert abs(found.bundle.camera.params[0] / 900 - 1) < 0.02
    monkeypatch.setattr(
        selfcalib, "_put_together", lambda *_: (_ for _ in ()).throw(EstimationError("none."))
    )
    with pytest.raises(EstimationError, match="none"):
        solve(tracks, 5)


def test_degenerate_cameras_have_no_dual_quadric(monkeypatch):
    """As of a plane of which one picture is there twice: the calibration starts from the pairs alone."""
    monkeypatch.setattr(dual_quadric, "of_pairs", lambda *_: np.zeros((3, 3, 4)))
    tracks = tracks_of(walk(5))
    assert dual_quadric.focal([], tracks, SIZE) is None
    found = solve(tracks, 5)
    assert found.dual_quadric is None and abs(found.bundle.camera.params[0] / 900 - 1) < 0.02
