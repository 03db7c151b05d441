"""A camera from one picture of orthogonal lines: truth, intervals, what is undetermined."""

import csv
import json

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from camcal.cli.group import camcal
from camcal.detect.segments import find_segments
from camcal.errors import DataError, EstimationError
from camcal.geometry import rotations
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.routes import scene_fit
from camcal.routes.line_geometry import Lines
from camcal.routes.scene import estimate
from camcal.routes.scene_bend import BENT, LEAST_POINTS, common_bend, with_distortion
from camcal.routes.scene_vote import Seen, families

SIZE = (640, 480)
PINHOLE = Camera(lenses.make("pinhole"), np.array([800.0, 800, 331, 236]), SIZE)
CORNER = rotations.exp([0, 0.75, 0]) @ rotations.exp([0.5, 0, 0.15])
LEVEL = rotations.exp([0, 0.7, 0])
KNOWN = {"cx": 331.0, "cy": 236.0}


def room(rotation, seed=0, noise=0.3, families=(0, 1, 2), count=25, clutter=0, camera=PINHOLE, points=5):
    rng = np.random.default_rng(seed)
    parts = []
    for axis in families:
        own = 0
        while own < count:
            start = rng.uniform(-3, 3, 3)
            along = start + np.linspace(0, 1, points)[:, None] * np.eye(3)[axis] * rng.uniform(0.6, 1.5)
            uv = camera.project(along @ rotation.T + [0, 0, 6])
            inside = np.isfinite(uv).all() and (uv > 4).all() and (uv < np.array(SIZE) - 5).all()
            if inside and np.linalg.norm(uv[-1] - uv[0]) > 40:
                parts.append(uv + rng.normal(0, noise, uv.shape))
                own += 1
    for _ in range(clutter):
        ends = rng.uniform(20, 460, 2) + np.outer([0, 1], rng.normal(0, 80, 2))
        parts.append(ends[0] + np.linspace(0, 1, points)[:, None] * (ends[1] - ends[0]))
    return Lines.of(parts, [str(i) for i in range(len(parts))], SIZE)


def sigmas(found):
    return np.sqrt(np.diagonal(found.covariance))


def test_three_directions_give_f_and_the_principal_point_with_sigmas():
    normed = []
    for seed in range(12):
        found = estimate(room(CORNER, seed), PINHOLE.lens, {})
        assert found.counts == (25, 25, 25) and found.assumed == ()
        normed.append((found.camera.params - PINHOLE.params)[[0, 2, 3]] / sigmas(found)[[0, 2, 3]])
    assert 0.5 < np.sqrt(np.mean(np.square(normed))) < 1.5  # 36 figures spread by 12 %
    assert np.abs(np.mean(normed, axis=0)).max() < 1.0  # no bias beside the sigmas


def test_the_attitude_is_that_of_the_room():
    found = estimate(room(CORNER), PINHOLE.lens, {})
    assert np.degrees(np.arccos(np.abs(CORNER.T @ found.rotation).max(0))).max() < 1


def test_clutter_is_left_out():
    lines = room(CORNER, clutter=25)
    found = estimate(lines, PINHOLE.lens, {})
    assert abs(found.camera.params[0] - 800) < 3 * sigmas(found)[0] < 40
    assert (found.family[75:] >= 0).mean() < 0.3


def test_a_lens_with_distortion():
    bent = Camera(lenses.make("division:1"), np.array([800.0, 800, 331, 236, -0.3]), SIZE)
    lines = room(CORNER, noise=0.1, camera=bent, points=15)
    found = estimate(lines, bent.lens, {})
    assert abs(found.camera.params[4] + 0.3) < 4 * sigmas(found)[4] < 0.2
    assert abs(found.camera.params[0] - 800) < 4 * sigmas(found)[0]


def test_a_level_camera_needs_its_principal_point():
    lines = room(LEVEL, 3)
    known = estimate(lines, PINHOLE.lens, KNOWN)
    assert abs(known.camera.params[0] - 800) < 3 * sigmas(known)[0] < 30
    assumed = estimate(lines, PINHOLE.lens, {})
    assert assumed.assumed == ("cx", "cy")
    assert sigmas(assumed)[0] > sigmas(known)[0]


@pytest.mark.parametrize("fix", [{}, {"fx": 800.0}])
def test_two_directions(fix):
    found = estimate(room(CORNER, families=(0, 2)), PINHOLE.lens, {**KNOWN, **fix})
    assert len(found.directions) == 2
    assert abs(found.camera.params[0] - 800) <= max(3 * sigmas(found)[0], 1e-9)


def test_what_is_undetermined_is_refused_by_name():
    with pytest.raises(EstimationError, match="at infinity"):
        estimate(room(np.eye(3), 5), PINHOLE.lens, KNOWN)
    with pytest.raises(EstimationError, match="parallel"):
        estimate(room(CORNER, families=(0,)), PINHOLE.lens, KNOWN)
    with pytest.raises(DataError, match="4 lines"):
        estimate(room(CORNER, families=(0, 1), count=2), PINHOLE.lens, KNOWN)


@pytest.mark.parametrize(("k", "bent", "off"), [(0.0, False, False), (-0.1, True, False), (-0.3, True, True)])
def test_lines_that_a_lens_bends_are_named(k, bent, off):
    """With -0.1 the interval without distortion still holds the focal length that distortion has."""
    lens = lenses.make("division:1")
    camera = Camera(
        lens, lens.from_values({"fx": 800.0, "fy": 800.0, "cx": 331.0, "cy": 236.0, "l1": k}), SIZE
    )
    lines = room(CORNER, noise=0.05, camera=camera, points=15)
    found = estimate(lines, PINHOLE.lens, {})
    assert (abs(common_bend(lines, found.camera.params[2:4])) > BENT) == bent
    other = with_distortion(found, lines, {}, 0, False)
    assert (other is not None) == off
    if other is not None:
        assert abs(other.camera.params[0] - 800) < 4 * sigmas(other)[0] < 10


def test_lines_of_few_points_say_nothing_of_a_bend():
    assert np.isnan(common_bend(room(CORNER, points=LEAST_POINTS - 1), PINHOLE.params[2:4]))
    assert np.isfinite(common_bend(room(CORNER, points=LEAST_POINTS), PINHOLE.params[2:4]))


@pytest.mark.parametrize("kind", ["exact", "through the centre", "points that repeat"])
def test_lines_without_a_bend_give_none_and_no_warning_of_numpy(kind, recwarn):
    t = np.linspace(0, 100, 6)
    levels = (50.0,) if kind == "through the centre" else (10.0, 50.0, 90.0)
    parts = [np.c_[t, 0 * t + y] for y in levels] + [np.c_[0 * t + y, t] for y in levels]
    if kind == "points that repeat":
        parts = [np.repeat(part[[0, -1]], 3, axis=0) for part in parts]
    lines = Lines.of(parts, [str(i) for i in range(len(parts))], (101, 101))
    assert np.isnan(common_bend(lines, np.array([50.0, 50.0]))) and not recwarn.list


def test_a_grid_parallel_to_the_picture_is_refused_whatever_bends_its_lines():
    """A bend of 15 px made up a focal length of 7621 ± 330 px for 1000."""
    lens, size = lenses.make("division:1"), (1280, 960)
    values = {"fx": 1000.0, "fy": 1000.0, "cx": 639.5, "cy": 479.5, "l1": -0.2}
    camera = Camera(lens, lens.from_values(values), size)
    rng, x, y = np.random.default_rng(1), np.linspace(-0.6, 0.6, 15), np.linspace(-0.45, 0.45, 12)
    level = [np.c_[x, np.full(15, -0.45 + 0.08 * i), np.ones(15)] for i in range(12)]
    upright = [np.c_[np.full(12, -0.6 + 0.085 * i), y, np.ones(12)] for i in range(15)]
    uv = [camera.project(line) + rng.normal(0, 0.1, (len(line), 2)) for line in level + upright]
    lines = Lines.of(uv, [str(i) for i in range(len(uv))], size)
    with pytest.raises(EstimationError, match="2 of 2 vanishing points are at infinity"):
        estimate(lines, PINHOLE.lens, {})


def test_segments_of_a_picture_are_where_the_edges_are():
    v, u = np.mgrid[0:200, 0:200].astype(float)
    for turn in (0.1, 0.8, 2.5):
        across = np.array([np.cos(turn), np.sin(turn)])
        off = (u - 100.3) * across[0] + (v - 99.8) * across[1]
        ends = find_segments((60 + 120 / (1 + np.exp(-2.2 * off))).round().astype(np.uint8))[0]
        assert np.abs((ends - [100.3, 99.8]) @ across).max() < 0.2
    assert len(find_segments(np.full((100, 100), 7, np.uint8))) == 0


def test_the_command(tmp_path):
    lines = room(LEVEL, 3)
    with (tmp_path / "room.csv").open("w", newline="") as handle:
        rows = [[i, u, v] for i, (u, v) in zip(lines.line, lines.uv.tolist(), strict=True)]
        csv.writer(handle).writerows([["line", "u", "v"], *rows])
    args = ["scene", str(tmp_path / "room.csv"), "--image-size", "640x480", "-q", "--format", "json"]
    done = CliRunner().invoke(camcal, args, standalone_mode=False)
    assert done.exception is None, done.output
    report = json.loads(done.output)
    assert report["scene"]["kind"] == "three"
    assert sum(p["at_infinity"] for p in report["scene"]["vanishing_points"]) == 1
    assert [w["code"] for w in report["warnings"]] == ["principal-point-assumed"]
    assert report["camera"]["parameters"]["cx"]["fixed"]
    cv2.imwrite(str(tmp_path / "grey.png"), np.full((100, 100), 7, np.uint8))
    done = CliRunner().invoke(camcal, ["scene", str(tmp_path / "grey.png")], standalone_mode=False)
    assert isinstance(done.exception, DataError)


def test_one_distortion_parameter_is_not_ignored_in_the_vote():
    """The same lines through a pinhole camera and through a division model of one parameter get the same weights."""
    rng = np.random.default_rng(2)
    plain = Camera(lenses.make("pinhole"), np.array([500.0, 500, 320, 240]), (640, 480))
    bent = Camera(lenses.make("division:1"), np.array([500.0, 500, 320, 240, -0.3]), (640, 480))
    rotation = rotations.exp(np.array([0.3, 0.5, 0.1]))
    axes = np.repeat(np.arange(3), 20)
    begin = np.c_[rng.uniform(-3, 3, 60), rng.uniform(-2.2, 2.2, 60), np.full(60, 5.0)]
    points = np.stack([begin, begin + rotation[:, axes].T], 1)
    found = []
    for camera in (plain, bent):
        ends = camera.project(points)
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        found.append(families(Seen(ends, np.full(60, 0.3), length), camera, rotation))
    for vote in found:
        assert (vote.family == axes).all()
    assert found[1].roots == pytest.approx(found[0].roots, rel=0.01)


def test_the_leverage_of_a_line_is_taken_out_of_its_residuals():
    """A line that determines three quarters of a direction shows half of its error in its residual."""
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    leverage = turn @ np.diag([0.75, 0.0, 1 - scene_fit.LEAST_LEFT]) @ turn.T
    found = scene_fit._corrections(leverage[None])[0]
    assert np.allclose(found, turn @ np.diag([2, 1, 10]) @ turn.T)
    for beyond in (0.999, 1.0, 1 + 1e-9):  # a line that alone determines a direction
        assert np.allclose(scene_fit._corrections(beyond * np.eye(3)[None])[0], 10 * np.eye(3))
    less = 1 - 1.21 * scene_fit.LEAST_LEFT
    assert np.allclose(scene_fit._corrections(less * np.eye(3)[None])[0], np.eye(3) / 0.11)


def test_undetermined_directions_have_no_part_in_the_covariance():
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    normal = turn @ np.diag([4.0, 1e-3, 0]) @ turn.T
    root = scene_fit._inverse_root(normal)
    assert root.shape == (3, 2)
    assert np.allclose(root @ root.T, np.linalg.pinv(normal, hermitian=True), rtol=1e-9)
