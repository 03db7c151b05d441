"""A lens from straight lines: detection, fit, choice of lines, what lines leave undetermined."""

import csv
import json
import math

import cv2
import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from camcal.cli.group import camcal
from camcal.data.observations import Correspondences
from camcal.detect.line_points import edges, noise, ridges
from camcal.detect.lines import find_lines
from camcal.errors import DataError, EstimationError
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.peers.undistort_points import against_cv2
from camcal.routes import between_lines, straightness
from camcal.routes.distortion_first import at_focal_length, held_parameters, without_distortion
from camcal.routes.line_geometry import Lines
from camcal.routes.line_start import estimate
from camcal.routes.lines import fit, held, inflation
from camcal.solve.parameters import nominal
from tests.sides import LESS, MORE

SIZE = (1280, 960)
BROWN = Camera(
    lenses.make("brown:radial=2,decentering=0"), np.array([1280.0, 1280, 652, 469, -0.25, 0.08]), SIZE
)
DIVISION = Camera(lenses.make("division:1"), np.array([1280.0, 1280, 652, 469, -0.4]), SIZE)
WIDE = Camera(lenses.make("kb4"), np.array([400.0, 400, 640, 480, 0.01, 0, 0, 0]), SIZE)


def lines_of(camera, count=60, noise_px=0.0, seed=0, points=40, angles=(0, 45, 90, 135)):
    """Straight lines in space through a lens; planes through the centre, cut at rays inside the picture."""
    rng = np.random.default_rng(seed)
    parts = []
    while len(parts) < count:
        turn = np.radians(rng.choice(angles) + rng.uniform(-8, 8))
        along, across = np.array([np.cos(turn), np.sin(turn), 0]), np.array([-np.sin(turn), np.cos(turn), 0])
        start = np.array([0, 0, 1]) + across * rng.uniform(-0.5, 0.5)
        uv = camera.project(start + np.linspace(-3, 3, 1200)[:, None] * along)
        uv = uv[np.isfinite(uv).all(1) & (uv > 4).all(1) & (uv < np.array(SIZE) - 5).all(1)]
        if len(uv) < points or np.linalg.norm(uv[-1] - uv[0]) < 300:
            continue
        chosen = uv[np.linspace(0, len(uv) - 1, points).astype(int)]
        parts.append(chosen + rng.normal(0, noise_px, chosen.shape))
    return Lines.of(parts, [str(i) for i in range(count)], SIZE)


@pytest.mark.parametrize("camera", [BROWN, DIVISION])
def test_exact_lines_give_the_lens(camera):
    found = estimate(lines_of(camera), camera.lens, {"fx": 1280.0, "fy": 1280.0}, robust=False)
    np.testing.assert_allclose(found.camera.params, camera.params, rtol=1e-6, atol=1e-5)
    assert found.converged
    assert found.fixed == ("fx", "fy")


def test_a_lens_beyond_a_pinhole():
    lines = lines_of(WIDE)
    found = estimate(lines, WIDE.lens, {"fx": 400.0, "fy": 400.0}, robust=False)
    assert straightness.in_picture(found.camera, lines).rms < 1e-3


@pytest.mark.parametrize(
    "model, most",
    [
        ("polynomial:3", 0.2),
        ("radial-profile:4,centre=free", 0.05),
        ("spline:4x4", 0.2),
        ("division:3", 0.05),
    ],
)
def test_models_that_do_not_hold_the_lens_exactly(model, most):
    """Noise of 0.05 px; what the model leaves of the distortion is below it, on lines that were not used, too.

    A cubic lacks the fifth powers of the lens.
    """
    lens = lenses.make(model)
    found = estimate(lines_of(BROWN, 25, 0.05, points=15), lens, {"fx": 1280.0, "fy": 1280.0}, robust=False)
    unused = lines_of(BROWN, 20, 0.0, seed=7, points=25)
    assert straightness.before(unused).rms > 2
    assert straightness.in_picture(found.camera, unused).rms < most


@pytest.mark.parametrize("model", ["polynomial:3", "spline:5x4"])
def test_models_that_hold_nearly_every_map_of_lines_settle(model):
    """Without a hold on what lines leave undetermined the cubic took 1,200 steps, and the spline left its domain."""
    lines = lines_of(BROWN, 14, 0.05, points=15, angles=(0,))
    found = estimate(lines, lenses.make(model), {}, robust=True)
    assert found.converged and found.iterations < 400
    assert straightness.in_picture(found.camera, lines).rms < 0.2
    # the hold itself says nothing of the parameters: lines of one direction leave some to a tenth of a focal length
    assert np.sqrt(np.diagonal(found.covariance)).max() > 0.1


def test_sigmas_are_those_of_the_errors():
    normed = []
    for seed in range(25):
        found = estimate(lines_of(DIVISION, 30, 0.1, seed), DIVISION.lens, {}, robust=False)
        error = (found.camera.params - DIVISION.params)[2:]
        normed.append(error @ np.linalg.inv(found.covariance[2:, 2:]) @ error)
    assert 0.6 < np.mean(normed) / 3 < 1.5  # the mean of 25 χ² with 3 degrees spreads by 16 %


def test_points_that_lie_on_no_line_lose_their_weight():
    clean = lines_of(BROWN, noise_px=0.1, seed=3)
    rng = np.random.default_rng(3)
    wrong = rng.random(len(clean.uv)) < 0.03
    uv = clean.uv + np.where(wrong[:, None], rng.normal(0, 15.0, clean.uv.shape), 0.0)
    lines = Lines(uv, clean.line, clean.names, SIZE)
    what = {"fx": 1280.0, "fy": 1280.0}
    off = {}
    for resistant in (False, True):
        found = estimate(lines, BROWN.lens, what, robust=False, resistant=resistant)
        off[resistant] = (found.camera.params - BROWN.params)[2:] / np.sqrt(np.diagonal(found.covariance))[2:]
        off[resistant, "k1"] = abs(found.camera.values["k1"] + 0.25)
    assert np.abs(off[True]).max() < 3.5  # sigmas hold: the largest of four
    assert off[True, "k1"] < 0.3 * off[False, "k1"]


def test_points_with_gaussian_noise_keep_their_weight():
    lines = lines_of(BROWN, noise_px=0.1, seed=4)
    what = {"fx": 1280.0, "fy": 1280.0}
    plain, resistant = (
        estimate(lines, BROWN.lens, what, robust=False, resistant=r).camera.params for r in (False, True)
    )
    np.testing.assert_allclose(resistant, plain, rtol=1e-4)


def test_no_shrinking_of_the_picture_with_noise():
    """Plain least squares of the undistorted points draws the coefficient to where the picture is smallest."""
    errors = []
    for seed in range(10):
        found = estimate(lines_of(DIVISION, 40, 1.0, seed), DIVISION.lens, {}, robust=False)
        errors.append((found.camera.params[4] - DIVISION.params[4]) / np.sqrt(found.covariance[4, 4]))
    assert abs(np.mean(errors)) < 3 / np.sqrt(10)


def test_curves_of_the_scene_are_left_out():
    lines = lines_of(DIVISION, 20, 0.05)
    t = np.linspace(0, 1.5, 60)
    arcs = [np.c_[300 + 250 * np.cos(t + k), 400 + 250 * np.sin(t + k)] for k in (0, 2)]
    parts = [lines.uv[lines.line == i] for i in range(20)] + arcs
    mixed = Lines.of(parts, [str(i) for i in range(22)], SIZE)
    found = estimate(mixed, DIVISION.lens, {}, robust=True)
    assert found.used[:20].all() and not found.used[20:].any()
    assert not np.isclose(estimate(mixed, DIVISION.lens, {}, robust=False).camera.params[4], -0.4, atol=0.01)


def test_a_free_centre_far_from_the_middle():
    camera = Camera(DIVISION.lens, np.array([1280.0, 1280, 500, 600, 0.06]), SIZE)
    lens = lenses.make("brown:radial=1,decentering=0,centre=free")
    lines = lines_of(camera, noise_px=0.02)
    found = estimate(lines, lens, {}, robust=False)
    assert straightness.in_picture(found.camera, lines).rms < 0.03
    np.testing.assert_allclose(639.5 + 1280 * found.camera.values["xc"], 500, atol=15)


def test_what_lines_cannot_say():
    lens = lenses.make("brown:radial=1,decentering=0,centre=free")
    straight = lines_of(Camera(lenses.make("pinhole"), np.array([1280.0, 1280, 640, 480]), SIZE), 20)
    start = nominal(lens, SIZE, {})
    lost = fit(straight, start, held(lens, {})).undetermined
    assert {"xc", "yc"} <= set(lost)  # without distortion its centre is anywhere
    with pytest.raises(DataError, match="1 line found"):
        fit(straight.take([0]), start, held(lens, {}))
    few = straight.take([0, 1])
    rows = np.r_[0:4, 40:44]
    few = Lines(few.uv[rows], few.line[rows], few.names, SIZE)
    with pytest.raises(EstimationError, match="4 equations for 5"):
        fit(few, nominal(lenses.make("division:3"), SIZE, {}), held(lenses.make("division:3"), {}))


def test_inflation_counts_what_neighbours_share():
    rng = np.random.default_rng(1)
    white = rng.normal(0, 1, 20000)
    group = np.repeat(np.arange(20), 1000)
    assert 0.9 < inflation(white, group) < 1.1
    smooth = np.convolve(
        white, np.ones(5), "same"
    )  # the variance of its mean is five times that of white noise
    assert 4.2 < inflation(smooth, group) < 5.8


# ---------------------------------------------------------------- pictures
def strings(width=2.5, amplitude=120, seed=0, noise_levels=2.0):
    """A picture of dark strings through DIVISION, drawn at four times the resolution."""
    truth = lines_of(DIVISION, 8, seed=3, points=200, angles=(0, 90))
    big = np.zeros((SIZE[1] * 4, SIZE[0] * 4), np.uint8)
    for i in range(8):
        uv = ((truth.uv[truth.line == i] + 0.5) * 4 - 0.5) * 16
        cv2.polylines(big, [uv.round().astype(np.int32)], False, 255, int(width * 4), cv2.LINE_AA, 4)
    dark = (
        cv2.GaussianBlur(cv2.resize(big, SIZE, interpolation=cv2.INTER_AREA).astype(float), (0, 0), 0.7) / 255
    )
    picture = 180 - amplitude * dark + np.random.default_rng(seed).normal(0, noise_levels, dark.shape)
    return picture.clip(0, 255).round().astype(np.uint8)


def test_strings_are_found_whole_and_to_a_twentieth_of_a_pixel():
    found = find_lines(strings())
    assert len(found) == 8
    lines = Lines.of(found, list("abcdefgh"), SIZE)
    fitted = estimate(lines, DIVISION.lens, {}, robust=True)
    assert fitted.used.sum() >= 7  # two of them cross at 3 degrees
    uv = np.stack(np.meshgrid(np.linspace(100, 1180, 9), np.linspace(100, 860, 7)), -1).reshape(-1, 2)
    apart = straightness.undistorted(fitted.camera, uv) - straightness.undistorted(DIVISION, uv)
    plane = np.c_[uv, np.ones(len(uv))]  # lines do not see affine maps
    apart -= plane @ np.linalg.lstsq(plane, apart, rcond=None)[0]
    assert np.abs(apart).max() < 0.3
    assert straightness.after(fitted.camera, lines.take(fitted.used)).rms < 0.05


def test_edges_and_thin_lines_to_a_twentieth_of_a_pixel_and_less_on_average():
    v, u = np.mgrid[0:80, 0:120].astype(float)
    turn = np.array([np.cos(0.3), np.sin(0.3)])
    off = (u - 60.3) * turn[0] + (v - 40.2) * turn[1]
    blurred = 0.5 + 0.5 * np.vectorize(math.erf)(off / 1.2)
    for points in (edges(20 + 200 * blurred), ridges(200 - 150 * np.exp(-(off**2) / 4), dark=True)):
        assert len(points) > 40
        distance = (points.uv - [60.3, 40.2]) @ turn
        assert np.abs(distance).max() < 0.06  # a parabola through three samples of a bell curve
        assert abs(distance.mean()) < 0.01
        assert np.abs(points.along @ turn).max() < 0.03
    assert abs(noise(np.random.default_rng(0).normal(100, 3, (200, 200))) / 3 - 1) < 0.05


@pytest.mark.parametrize("bright", [False, True])
def test_the_feet_of_lines_without_noise_are_no_lines(bright):
    """Rounded to whole grey levels, the foot of a dark line is a bright one on either side, of a thousandth of it."""
    v, u = np.mgrid[0:300, 0:400].astype(float)
    places = np.array([60.3, 160.2, 249.9])
    off = np.abs(u[..., None] - 0.15 * v[..., None] - places).min(-1) / np.hypot(1, 0.15)
    dark = sum(s * np.vectorize(math.erf)((off + s * 2) / (0.85 * math.sqrt(2))) / 2 for s in (1, -1))
    picture = np.rint(40 + 175 * dark if bright else 215 - 175 * dark).astype(np.uint8)
    found = sorted(float((uv[:, 0] - 0.15 * uv[:, 1]).mean()) for uv in find_lines(picture))
    np.testing.assert_allclose(found, places, atol=0.05)


def test_noise_alone_has_no_lines():
    picture = np.random.default_rng(0).normal(120, 8, (400, 500)).clip(0, 255).astype(np.uint8)
    assert find_lines(picture) == []


# ---------------------------------------------------------------- with a calibration, and the commands
def test_the_same_map_at_another_focal_length():
    moved = at_focal_length(DIVISION, 900.0)
    uv = np.array([[30.0, 40], [1200, 900], [640, 100]])
    np.testing.assert_allclose(
        straightness.undistorted(moved, uv), straightness.undistorted(DIVISION, uv), atol=1e-6
    )
    assert set(held_parameters(moved)) == {"l1", "cx", "cy", "aspect"}
    xyz = np.array([[0.1, 0.2, 1], [0.3, -0.1, 1], [0, 0, 1], [0.1, -0.2, 1]])
    flat = without_distortion(DIVISION, Correspondences.from_views([(xyz, DIVISION.project(xyz))]))
    np.testing.assert_allclose(flat.views[0].uv, 1280 * xyz[:, :2] + [652, 469], atol=1e-6)


def test_the_cross_check():
    uv = np.array([[30.0, 40], [1200, 900], [640, 100]])
    assert against_cv2("lines", BROWN, uv)["status"] == "pass"
    assert against_cv2("lines", DIVISION, uv)["status"] == "not_applicable"


def run(*args):
    done = CliRunner().invoke(camcal, [*map(str, args), "-q", "--format", "json"], standalone_mode=False)
    if done.exception is not None:
        raise done.exception
    return json.loads(done.output)


def write(path, lines):
    with path.open("w", newline="") as handle:
        rows = [[lines.names[i], u, v] for i, (u, v) in zip(lines.line, lines.uv.tolist(), strict=True)]
        csv.writer(handle).writerows([["line", "u", "v"], *rows])


def test_the_commands(tmp_path):
    write(tmp_path / "lines.csv", lines_of(BROWN, 30, 0.1))
    write(tmp_path / "parallel.csv", lines_of(BROWN, 12, 0.1, angles=(0,)))
    camera = tmp_path / "camera.yaml"
    report = run(
        "lines", tmp_path / "lines.csv", "-m", BROWN.lens.name, "--image-size", "1280x960", "-o", camera
    )
    assert report["straightness"]["before"]["rms"] > 1 > 0.2 > report["straightness"]["after"]["rms"]
    assert report["crosscheck"][0]["status"] == "pass"
    assert report["camera"]["parameters"]["fx"]["fixed"]
    again = run("evaluate", camera, "--lines", tmp_path / "parallel.csv")
    assert again["straightness"]["after"]["rms"] < 0.2
    parallel = run("lines", tmp_path / "parallel.csv", "-m", "division:1", "--image-size", "1280x960")
    assert [w["code"] for w in parallel["warnings"]] == ["one-direction"]
    cv2.imwrite(str(tmp_path / "grey.png"), np.full((200, 300), 128, np.uint8))
    with pytest.raises(DataError, match="no line"):
        run("lines", tmp_path / "grey.png")


def some_bent(seed):
    """Eight lines, two of them bent by about 1.5 px."""
    rng = np.random.default_rng(seed)
    lines = lines_of(DIVISION, 8, 0.2, points=30, seed=seed)
    bend = np.linspace(-1, 1, 30) ** 2 - 1 / 3
    across = rng.normal(0, 1.5, (2, 2))
    lines.uv[:60] += np.concatenate([bend[:, None] * a for a in across])
    return lines


def test_the_scatter_between_curves_is_in_the_sigmas():
    off = {False: [], True: []}
    for seed in range(20):
        lines = some_bent(seed)
        for candidates in off:
            found = fit(lines, DIVISION, {"fx": None, "fy": None, "cx": None, "cy": None}, scatter=candidates)
            off[candidates].append(
                (found.camera.params[-1] - DIVISION.params[-1]) / found.covariance[-1, -1] ** 0.5
            )
    hold = {k: np.mean(np.abs(v) <= 1.96) for k, v in off.items()}
    assert (
        hold[False] < 0.8 and hold[True] >= 0.85
    )  # of 20 intervals of 95 %, 17 or more hold in 98 % of cases


def test_curves_without_mistakes_are_as_certain_as_their_points_say():
    lines = lines_of(DIVISION, 40, 0.2, points=15)
    held = {"fx": None, "fy": None, "cx": None, "cy": None}
    alone, scatter = (fit(lines, DIVISION, held, scatter=c).covariance[-1, -1] for c in (False, True))
    assert 1 <= scatter / alone < 1.6  # a variance of 40 values is off by 22 %, Student's t adds 6 %


@pytest.mark.parametrize(("share", "counts"), [(LESS, False), (MORE, True)])
def test_a_line_that_alone_determines_a_direction(share, counts):
    """Two lines and a parameter: the second's part of it is 1 - leverage of the first."""
    small = np.sqrt(share * between_lines.ALONE)
    moves = np.repeat([np.sqrt(1 - small**2), small], 3)[:, None] / np.sqrt(3)
    lines = Lines.of([np.zeros((3, 2)), np.zeros((3, 2))], ["a", "b"], SIZE)
    changes = between_lines.changes_without(lines, moves, np.zeros((6, 2)), np.full(6, 1.0))
    assert (changes[0] != 0).all() == counts


def test_weights_act_from_the_optimum_without_them():
    rng = np.random.default_rng(0)
    lines = lines_of(DIVISION, 12, 0.1, points=30)
    wrong = rng.random(len(lines.uv)) < 0.1
    lines.uv[wrong] += rng.normal(0, 6, (int(wrong.sum()), 2))
    held = {"fx": None, "fy": None, "cx": None, "cy": None}
    plain = fit(lines, DIVISION, held)
    found = [fit(lines, start, held, True).camera.params[-1] for start in (DIVISION, plain.camera)]
    error = abs(plain.camera.params[-1] - DIVISION.params[-1])
    assert np.abs(np.subtract(found, DIVISION.params[-1])).max() < error / 2 and np.ptp(found) < error / 50


@pytest.mark.parametrize(("size", "warned"), [("1280x960", False), ("640x480", True)])
def test_lines_outside_the_picture_are_named(tmp_path, size, warned):
    lines, path, out = lines_of(DIVISION, 12, 0.1, points=12), tmp_path / "lines.csv", tmp_path / "lens.yaml"
    with path.open("w", newline="") as handle:
        rows = [[n, *uv] for n, uv in zip(lines.line.tolist(), lines.uv.tolist(), strict=True)]
        csv.writer(handle).writerows([["line", "u", "v"], *rows])
    given = ["lines", str(path), "-m", "division:1", "--image-size", size, "-o", str(out)]
    assert CliRunner().invoke(camcal, given).exit_code == 0
    codes = [w["code"] for w in yaml.safe_load(out.read_text())["warnings"]]
    assert ("points-outside-image" in codes) == warned
