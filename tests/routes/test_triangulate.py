"""Triangulation: least squares, covariances, outlier views, cameras of a left-handed world."""

import csv
import json

import numpy as np
import pytest
from click.testing import CliRunner

from camcal.cli.group import camcal
from camcal.data.dlt_table import dlt_text
from camcal.errors import DataError, EstimationError
from camcal.geometry import projective
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from camcal.peers.triangulate_points import against_cv2
from camcal.report.placed import load_placed
from camcal.report.triangulation import _warnings
from camcal.routes import triangulate as triangulation
from camcal.routes.distance import LINEAR
from camcal.routes.placed import PlacedCamera
from camcal.routes.triangulate import far_half_widths, sorted_images, triangulate

FISHEYE = Camera(lenses.make("kb4"), np.array([400.0, 400, 480, 360, 0.02, -0.01, 0.001, 0]), (960, 720))
PINHOLE = Camera(lenses.make("pinhole"), np.array([1400.0, 1400, 480, 360]), (960, 720))


def looking_in(camera, position):
    z = -np.array(position) / np.linalg.norm(position)
    x = np.cross(z, [0, 0, 1.0])
    x /= np.linalg.norm(x)
    rotation = np.array([x, np.cross(z, x), z])
    return PlacedCamera(str(position), camera, Pose(rotation, -rotation @ position))


PLACES = [(3.2, -2.4, 1.1), (-2.9, -2.8, 1.6), (0.4, 3.6, 1.3), (3.0, 3.0, -1.0)]


def laboratory(camera=PINHOLE, count=4):
    return [looking_in(camera, p) for p in PLACES[:count]]


def images_of(cameras, world, noise=0.0, seed=0):
    rng = np.random.default_rng(seed)
    uv = np.concatenate([c.project(world) for c in cameras])
    which, point = np.divmod(np.arange(len(uv)), len(world))
    return sorted_images(which, point, uv + rng.normal(0, noise, uv.shape))[0]


WORLD = np.random.default_rng(1).uniform(-0.5, 0.5, (60, 3))


@pytest.mark.parametrize("camera", [PINHOLE, FISHEYE])
@pytest.mark.parametrize("count", [2, 4])
def test_exact_images_give_the_points(camera, count):
    cameras = laboratory(camera, count)
    found = triangulate(cameras, images_of(cameras, WORLD), len(WORLD))
    np.testing.assert_allclose(found.xyz, WORLD, atol=1e-9)
    assert found.used.all()


def test_covariances_are_those_of_the_errors():
    cameras = laboratory(count=3)
    normed = []
    for seed in range(30):
        found = triangulate(cameras, images_of(cameras, WORLD, 0.5, seed), len(WORLD))
        normed.append(
            np.einsum("pi,pij,pj->p", found.xyz - WORLD, np.linalg.inv(found.covariance), found.xyz - WORLD)
        )
        assert found.used.mean() > 0.99
    assert abs(np.mean(normed) / 3 - 1) < 0.1  # the mean of χ² with 3 degrees; 1800 values spread by 2 %


def test_an_outlier_image_is_left_out_and_the_point_stays():
    cameras = laboratory()
    images = images_of(cameras, WORLD, 0.3)
    wrong = [4 * 7 + 2, 4 * 20]  # an image each of the points 7 and 20
    images.uv[wrong] += 25
    found = triangulate(cameras, images, len(WORLD))
    assert set(wrong) <= set(np.flatnonzero(~found.used).tolist())
    assert (~found.used).sum() <= 4
    assert np.abs(found.xyz - WORLD).max() < 0.01


def test_a_left_handed_world_turns_the_cameras_over():
    flip = np.diag([1.0, 1, -1, 1])
    matrices = [c.matrix @ flip for c in laboratory(count=3)]
    cameras = [PlacedCamera.of_matrix(str(i), m) for i, m in enumerate(matrices)]
    uv = np.concatenate([projective.project(m, WORLD) for m in matrices])
    which, point = np.divmod(np.arange(len(uv)), len(WORLD))
    found = triangulate(cameras, sorted_images(which, point, uv)[0], len(WORLD))
    np.testing.assert_allclose(found.xyz, WORLD, atol=1e-9)


def test_undetermined_points_have_a_reason():
    camera = looking_in(PINHOLE, PLACES[0])
    other = PlacedCamera("other", PINHOLE, Pose(camera.pose.rotation, camera.pose.translation + [0.01, 0, 0]))
    far = camera.pose.inverse().apply(np.array([[0.1, 0.2, 1.0]]) * 1e9)
    near = np.zeros((1, 3))
    world = np.r_[far, near, near]
    images = images_of([camera, other], world)
    keep = np.arange(len(images)) != 5
    images = sorted_images(images.camera[keep], images.point[keep], images.uv[keep])[0]
    found = triangulate([camera, other], images, 3)
    assert found.reason == ("its rays are parallel", "", "one image")
    assert np.isnan(found.xyz[[0, 2]]).all()
    with pytest.raises(DataError, match="two images"):
        triangulate([camera], sorted_images(np.zeros(3, int), np.arange(3), np.zeros((3, 2)))[0], 3)
    with pytest.raises(DataError, match="same point in the same camera"):
        sorted_images(np.zeros(2, int), np.zeros(2, int), np.zeros((2, 2)))


def test_the_same_camera_twice_determines_no_point():
    cameras = laboratory(count=1) * 2
    with pytest.raises(EstimationError, match="none of 60 points is determined"):
        triangulate(cameras, images_of(cameras, WORLD, 0.3), len(WORLD))


@pytest.mark.parametrize("flipped", [False, True])
def test_images_that_do_not_belong_to_the_cameras_are_named(flipped):
    cameras = laboratory(count=3)
    images = images_of(cameras, WORLD, 1.0)
    if flipped:
        images.uv[:, 1] = 719 - images.uv[:, 1]
    found = triangulate(cameras, images, len(WORLD))
    codes = [w["code"] for w in _warnings({"undetermined": []}, found, images, list(map(str, range(60))))]
    assert ("images-do-not-fit" in codes) == flipped


def test_a_point_that_the_fit_moves_to_infinity_is_undetermined(monkeypatch):
    """Rays that part have no nearest point in front: a fit may end so far away that its equations are singular."""
    cameras = laboratory(count=3)
    images = images_of(cameras, WORLD[:4], 0.3)
    usual = triangulate(cameras, images, 4)
    adjusted = triangulation._adjusted

    def run_away(*args):
        fit = adjusted(*args)
        fit.normal.blocks[2] = np.diag([1.0, 1.0, 0.0])
        return fit

    monkeypatch.setattr(triangulation, "_adjusted", run_away)
    found = triangulate(cameras, images, 4)
    assert found.reason == ("", "", "its rays are parallel", "")
    others = [0, 1, 3]
    assert np.isnan(found.xyz[2]).all() and np.array_equal(found.xyz[others], usual.xyz[others])
    ratio = np.diagonal(found.covariance[others] / usual.covariance[others], axis1=1, axis2=2)
    assert np.allclose(ratio, (found.sigma_hat / usual.sigma_hat) ** 2)


def test_the_normal_matrix_of_nearly_parallel_rays():
    for share, known in ((1.1, True), (0.9, False)):
        lean = np.sqrt(1 - 2 * share * triangulation.PARALLEL)  # least eigenvalue 1 - lean
        units = np.diag([1e3, 1e-4, 2.0])
        block = units @ np.array([[1, lean, 0], [lean, 1, 0], [0, 0, 1]]) @ units
        inverse, found = triangulation._inverses(block[None])
        assert found[0] == known
        if known:
            variance = 1 / (2 * share * triangulation.PARALLEL)  # of the unit matrix, 1 / (1 - lean²)
            assert inverse[0, 0, 0] == pytest.approx(variance / 1e6, rel=1e-3)  # conditioned to 1e12


@pytest.mark.parametrize(("noise", "warned"), [(0.3, 0), (2.0, 20)])
def test_distances_along_nearly_parallel_rays(noise, warned):
    """Two cameras 3 cm apart before points at 4 m: rays at .43 degrees."""
    camera = looking_in(PINHOLE, PLACES[0])
    other = PlacedCamera("other", PINHOLE, Pose(camera.pose.rotation, camera.pose.translation + [0.03, 0, 0]))
    images = images_of([camera, other], WORLD[:20], noise)
    found = triangulate([camera, other], images, 20)
    wide = far_half_widths(found, images)
    assert ((wide > LINEAR) & found.known).sum() == (found.known.sum() if warned else 0)
    codes = [w["code"] for w in _warnings({"undetermined": []}, found, images, [str(i) for i in range(20)])]
    assert ("uncertain-distance" in codes) == bool(warned)


def test_cv2_agrees_and_a_worse_point_fails():
    cameras = laboratory(count=2)
    images = images_of(cameras, WORLD, 0.3)
    found = triangulate(cameras, images, len(WORLD))
    sides = [(c.camera, c.pose, images.uv[images.camera == i]) for i, c in enumerate(cameras)]
    assert against_cv2(*sides, found.xyz)["status"] == "pass"
    assert against_cv2(*sides, found.xyz + 1e-3)["status"] == "fail"


def test_the_command_reads_dlt_coefficients(tmp_path):
    cameras = laboratory(count=3)
    (tmp_path / "cameras.csv").write_text(dlt_text([c.matrix for c in cameras]))
    images = images_of(cameras, WORLD, 0.3)
    rows = [
        [c + 1, f"p{p}", u, v] for c, p, (u, v) in zip(images.camera, images.point, images.uv, strict=True)
    ]
    with (tmp_path / "points.csv").open("w", newline="") as handle:
        csv.writer(handle).writerows([["camera", "point", "u", "v"], *rows, [1, "alone", 3, 4]])
    args = ["triangulate", str(tmp_path / "cameras.csv"), str(tmp_path / "points.csv"), "-q"]
    done = CliRunner().invoke(
        camcal, [*args, "-o", str(tmp_path / "xyz.csv"), "--format", "json"], standalone_mode=False
    )
    assert done.exception is None, done.output
    report = json.loads(done.output)
    assert report["crosscheck"][0]["status"] == "pass"
    assert report["undetermined"] == [{"point": "alone", "reason": "one image"}]
    assert report["warnings"][0]["code"] == "undetermined-points"
    with (tmp_path / "xyz.csv").open() as handle:
        found = list(csv.DictReader(handle))
    assert [p["point"] for p in found] == [f"p{i}" for i in range(len(WORLD))]
    np.testing.assert_allclose([[float(p[k]) for k in "XYZ"] for p in found], WORLD, atol=0.01)


def test_a_report_of_one_view_becomes_coefficients(tmp_path):
    camera = laboratory(count=1)[0]
    rows = np.c_[WORLD, camera.project(WORLD)]
    with (tmp_path / "points.csv").open("w", newline="") as handle:
        csv.writer(handle).writerows([["X", "Y", "Z", "u", "v"], *rows.tolist()])
    report, table = tmp_path / "view.yaml", tmp_path / "one.csv"
    estimate = ["estimate", tmp_path / "points.csv", "-m", "pinhole", "--image-size", "960x720", "-o", report]
    for args in (estimate, ["convert", report, table, "--to", "dlt"]):
        done = CliRunner().invoke(camcal, [*map(str, args), "-q"], standalone_mode=False)
        assert done.exception is None, done.output
    (found,) = load_placed(table)
    np.testing.assert_allclose(found.project(WORLD), camera.project(WORLD), atol=1e-6)
