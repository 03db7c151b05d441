"""Poses of a known camera: all minima, covariances, outliers, what is undetermined."""

import csv
import json

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

from camcal.cli.group import camcal
from camcal.data.observations import View
from camcal.errors import DataError, EstimationError
from camcal.geometry import rotations
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from camcal.peers.solve_pnp import against_cv2
from camcal.routes import misfit
from camcal.routes import pose as routes_pose
from camcal.routes.distance import LINEAR
from camcal.start import absolute_pose
from tests.shared_data import DATA, needs_data
from tests.sides import LESS, MORE

PINHOLE = Camera(lenses.make("pinhole"), np.array([700.0, 700, 320, 240]), (640, 480))
WIDE = Camera(lenses.make("kb4"), np.array([300.0, 300, 320, 240, 0.02, -0.01, 0.001, 0]), (640, 480))
SQUARE = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * 0.05


def turned(pose, truth):
    return np.degrees(rotations.angle_between(pose.rotation, truth.rotation))


def scene(rng, count=8, planar=False, depth=0.8):
    xyz = rng.uniform(-0.15, 0.15, (count, 3))
    if planar:
        xyz[:, 2] = 0
    pose = Pose(rotations.exp(rng.normal(0, 0.8, 3)), np.array([*rng.uniform(-0.1, 0.1, 2), depth]))
    return xyz, pose


@given(st.integers(0, 10**6), st.sampled_from([3, 4, 6, 40]), st.booleans())
@settings(max_examples=60, deadline=None)
def test_exact_points_give_the_pose_among_the_solutions(seed, count, planar):
    xyz, truth = scene(np.random.default_rng(seed), count, planar)
    if np.linalg.svd(xyz - xyz.mean(0))[1][1] < 0.05:
        return  # nearly on a line: its own test
    found = routes_pose.find(PINHOLE, View("v", xyz, PINHOLE.project(truth.apply(xyz))))
    assert min(turned(s.pose, truth) for s in found.solutions) < 1e-4
    assert found.used.all()


def test_rays_beyond_a_right_angle():
    rng = np.random.default_rng(2)
    xyz = rng.normal(0, 1, (30, 3))
    truth = Pose(rotations.exp([0.3, -0.2, 0.5]), np.array([0.05, 0.1, 0.1]))  # the camera among the points
    uv = WIDE.project(truth.apply(xyz))
    inside = np.isfinite(uv).all(1)
    assert (truth.apply(xyz)[inside, 2] < 0).any()
    found = routes_pose.find(WIDE, View("v", xyz[inside], uv[inside]))
    assert turned(found.solutions[0].pose, truth) < 1e-6


def test_both_poses_of_a_small_plane_with_their_ratio():
    rng = np.random.default_rng(5)
    truth = Pose(rotations.exp([0.5, 0, 0]), np.array([0.0, 0, 2.0]))
    xyz = SQUARE * 0.4
    uv = PINHOLE.project(truth.apply(xyz)) + rng.normal(0, 0.3, (4, 2))
    found = routes_pose.find(PINHOLE, View("v", xyz, uv))
    assert len(found.solutions) == 2
    assert found.ratio >= 1
    assert min(turned(s.pose, truth) for s in found.solutions) < 15
    near = routes_pose.find(PINHOLE, View("v", SQUARE * 4, PINHOLE.project(truth.apply(SQUARE * 4))))
    assert len(near.solutions) == 1  # exact corners of a large square: the second minimum is no noise
    assert near.ratio is None


@pytest.mark.parametrize("turn", [0.0, 30.0, 90.0])
def test_a_square_straight_on_is_finite(turn):
    truth = Pose(rotations.exp([0, 0, np.radians(turn)]), np.array([0.0, 0, 0.6]))
    uv = PINHOLE.project(truth.apply(SQUARE)).round()
    found = routes_pose.find(PINHOLE, View("v", SQUARE, uv))
    for solution in found.solutions:
        assert np.isfinite([*solution.pose.rotation.ravel(), *solution.pose.translation]).all()
    assert abs(found.solutions[0].pose.translation[2] - 0.6) < 0.02


@pytest.mark.parametrize("count", [8, 60])
def test_gross_outliers_are_left_out_and_good_points_kept(count):
    rng = np.random.default_rng(3)
    wrong = count // 4
    for _ in range(5):
        xyz, truth = scene(rng, count)
        uv = PINHOLE.project(truth.apply(xyz)) + rng.normal(0, 0.3, (count, 2))
        clean = routes_pose.find(PINHOLE, View("v", xyz, uv))
        assert clean.used.mean() >= 0.9
        uv[:wrong] += rng.choice([-1, 1], (wrong, 2)) * rng.uniform(20, 60, (wrong, 2))
        found = routes_pose.find(PINHOLE, View("v", xyz, uv))
        assert not found.used[:wrong].any()
        assert turned(found.solutions[0].pose, truth) < 2
        assert routes_pose.find(PINHOLE, View("v", xyz, uv), robust="none").used.all()


def test_covariance_is_the_spread_of_repeated_views():
    rng = np.random.default_rng(4)
    xyz, truth = scene(rng, 12)
    exact, errors, said = PINHOLE.project(truth.apply(xyz)), [], []
    for _ in range(300):
        view = View("v", xyz, exact + rng.normal(0, 0.5, exact.shape), np.full(12, 0.5))
        one = routes_pose.find(PINHOLE, view, robust="none").solutions[0]
        step = rotations.log(one.pose.rotation @ truth.rotation.T), one.pose.translation - truth.translation
        errors.append(np.concatenate(step))
        said.append(np.diag(one.covariance))
    ratio = np.var(errors, axis=0) / np.mean(said, axis=0)
    assert (abs(ratio - 1) < 0.35).all()  # 300 variances spread by 8 %: four of these


def test_what_is_undetermined_is_refused_by_name():
    line = np.outer(np.arange(5.0), [1, 2, 0.5])
    uv = PINHOLE.project(line + [0, 0, 10])
    with pytest.raises(EstimationError, match="on a line"):
        routes_pose.find(PINHOLE, View("v", line, uv))
    with pytest.raises(EstimationError, match="coincide"):
        routes_pose.find(PINHOLE, View("v", np.ones((4, 3)), uv[:4]))
    with pytest.raises(DataError, match="2 points"):
        routes_pose.find(PINHOLE, View("v", line[:2], uv[:2]))
    beside = line.copy()
    beside[2] += [0.1, 0, 0]
    routes_pose.find(PINHOLE, View("v", beside, PINHOLE.project(beside + [0, 0, 10])))


def test_three_points_have_a_covariance_with_sigmas_alone():
    xyz, truth = scene(np.random.default_rng(8), 3)
    uv = PINHOLE.project(truth.apply(xyz))
    assert routes_pose.find(PINHOLE, View("v", xyz, uv)).solutions[0].covariance is None
    known = routes_pose.find(PINHOLE, View("v", xyz, uv, np.full(3, 0.5))).solutions[0].covariance
    half = routes_pose.find(PINHOLE, View("v", xyz, uv, np.full(3, 0.25))).solutions[0].covariance
    np.testing.assert_allclose(known, 4 * half, rtol=1e-6)


def test_a_hundred_thousand_points():
    rng = np.random.default_rng(9)
    xyz, truth = scene(rng, 100_000)
    uv = PINHOLE.project(truth.apply(xyz)) + rng.normal(0, 0.5, (100_000, 2))
    found = routes_pose.find(PINHOLE, View("v", xyz, uv))
    assert found.used.mean() > 0.9999
    assert turned(found.solutions[0].pose, truth) < 0.01


def test_candidates_are_the_minima_whatever_the_frame():
    rng = np.random.default_rng(10)
    xyz, truth = scene(rng, 7)
    rays = PINHOLE.unproject(PINHOLE.project(truth.apply(xyz)))
    move = Pose(rotations.exp([0.4, 2.0, -1]), np.array([30.0, -20, 5]))
    here, there = absolute_pose.candidates(xyz, rays)[0], absolute_pose.candidates(move.apply(xyz), rays)[0]
    np.testing.assert_allclose((there @ move).rotation, here.rotation, atol=1e-7)
    np.testing.assert_allclose((there @ move).translation, here.translation, atol=1e-7)


@pytest.mark.parametrize("planar", [False, True])
def test_the_cross_check_agrees_and_notices_a_worse_pose(planar):
    rng = np.random.default_rng(6)
    xyz, truth = scene(rng, 10, planar)
    uv = PINHOLE.project(truth.apply(xyz)) + rng.normal(0, 0.5, (10, 2))
    best = routes_pose.find(PINHOLE, View("v", xyz, uv)).solutions[0].pose
    good = against_cv2(PINHOLE, xyz, uv, best)
    assert good["status"] == "pass", good
    assert good["difference"]["rotation_deg"] < 0.05
    worse = Pose(rotations.exp([0.01, 0, 0]) @ best.rotation, best.translation)
    assert against_cv2(PINHOLE, xyz, uv, worse)["status"] == "fail"


@pytest.mark.parametrize(("noise", "warned"), [(0.1, False), (0.5, True)])
def test_the_distance_of_a_small_far_target(tmp_path, noise, warned):
    """12 points within 2 mm at .8 m: half of the 95 % interval is 9 % and 44 % of the distance."""
    rng = np.random.default_rng(3)
    xyz, truth = (
        rng.uniform(-0.001, 0.001, (12, 3)),
        Pose(rotations.exp([0.3, -0.4, 0.2]), np.array([0, 0, 0.8])),
    )
    uv = PINHOLE.project(truth.apply(xyz)) + rng.normal(0, noise, (12, 2))
    found = routes_pose.find(PINHOLE, View("v", xyz, uv), "none")
    half = found.distance_half_width(View("v", xyz, uv))
    assert (half > LINEAR) == warned and 0.05 < half < 0.6
    warnings = command_report(tmp_path, xyz, uv, "--robust", "none")["warnings"]
    assert ("uncertain-distance" in [w["code"] for w in warnings]) == warned


def command_report(tmp_path, xyz, uv, *more):
    with (tmp_path / "points.csv").open("w", newline="") as handle:
        csv.writer(handle).writerows([["X", "Y", "Z", "u", "v"], *np.c_[xyz, uv].tolist()])
    (tmp_path / "camera.yml").write_text(
        "%YAML:1.0\n---\ncamera_matrix: [700, 0, 320, 0, 700, 240, 0, 0, 1]\ndistortion_coefficients: []\n"
    )
    args = [
        "pose",
        str(tmp_path / "camera.yml"),
        str(tmp_path / "points.csv"),
        "--format",
        "json",
        "-q",
        *more,
    ]
    done = CliRunner().invoke(camcal, args, standalone_mode=False)
    assert done.exception is None, done.output
    return json.loads(done.output)


def test_the_command(tmp_path):
    rng = np.random.default_rng(7)
    xyz, truth = scene(rng, 9)
    uv = PINHOLE.project(truth.apply(xyz)) + rng.normal(0, 0.2, (9, 2))
    uv[4] += 50
    report = command_report(tmp_path, xyz, uv)
    assert report["views"][0]["rejected"][0]["row"] == 4
    assert report["crosscheck"][0]["status"] == "pass"
    found = report["solutions"][0]["cam_from_world"]["translation"]
    assert np.abs(np.array(found) - truth.translation).max() < 0.02


@pytest.mark.parametrize("planar", [False, True])
@pytest.mark.parametrize("upwards", [False, True])
def test_images_counted_upwards_are_named_where_the_points_tell(upwards, planar):
    rng = np.random.default_rng(5)
    xyz, truth = scene(rng, 10, planar)
    uv = PINHOLE.project(truth.apply(xyz)) + rng.normal(0, 0.3, (10, 2))
    if upwards:
        uv[:, 1] = 480 - uv[:, 1]
    view = View("v", xyz, uv)
    seen = routes_pose.fits_mirrored(PINHOLE, view, routes_pose.find(PINHOLE, view))
    assert (seen is not None) == (upwards and not planar)  # a plane mirrored is seen from its other side
    if seen is not None:
        assert seen[1] < 1 < seen[0]


@needs_data
def test_control_points_of_an_aerial_picture_counted_upwards():
    cases = DATA / "cases"
    result = CliRunner().invoke(
        camcal, ["pose", str(cases / "cam.yaml"), str(cases / "gcp4.csv"), "--format", "json"]
    )
    warning = next(w for w in json.loads(result.stdout)["warnings"] if w["code"] == "mirrored-points")
    assert "v increases upwards" in warning["message"] and "0.00513 px" in warning["message"]


@pytest.mark.parametrize("exchanged", [0, 4])
def test_points_that_do_not_belong_to_their_images_are_named(tmp_path, exchanged):
    """Half of eight points exchanged."""
    rng = np.random.default_rng(0)
    xyz = rng.uniform(-0.2, 0.2, (8, 3))
    uv = PINHOLE.project(Pose(rotations.exp([0.3, -0.4, 0.2]), np.array([0, 0, 0.8])).apply(xyz))
    uv[:exchanged] = np.roll(uv[:exchanged], 1, 0)
    found = command_report(tmp_path, xyz, uv + rng.normal(0, 0.3, uv.shape), "--robust", "none")
    assert ("images-do-not-fit" in [w["code"] for w in found["warnings"]]) == bool(exchanged)


@pytest.mark.parametrize(("share", "warned"), [(LESS, False), (MORE, True)])
def test_residuals_that_are_no_noise(share, warned):
    uv = np.array([[0.0, 0], [8, 0], [0, 6], [8, 6], [100, 100], [108, 100], [100, 106], [108, 106]])
    residuals = np.full((8, 2), 5 / np.sqrt(2) * share * misfit.LARGE)
    assert (misfit.misfit(residuals, uv, np.repeat([0, 1], 4)) > misfit.LARGE) == warned
    assert (
        misfit.misfit(residuals[:2], uv[:2], np.array([0, 1])) == 0
    )  # an image of each camera has no spread
