"""Wand calibration: truth and intervals on made scenes, wrong tracks, files of DLTdv, what is refused."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from camcal.cli.group import camcal
from camcal.data.dlt_table import read_dlt
from camcal.errors import DataError, EstimationError
from camcal.geometry import rotations
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from camcal.routes import assumed_centre
from camcal.routes.wand import estimate
from camcal.routes.wand_fit import Sightings, adjust

SIZE = (1280, 1024)
NAMES = ("a", "b", "c")
LENS = lenses.make("opencv4")
CAMERAS = [
    Camera(LENS, np.array([f, f, 645.0, 500.0, k, 0.02, 0, 0]), SIZE)
    for f, k in ((1100.0, -0.12), (1300.0, -0.05), (1200.0, -0.1))
]


def looking(position):
    z = -np.array(position) / np.linalg.norm(position)
    x = np.cross(z, [0, 0, 1.0])
    x /= np.linalg.norm(x)
    rotation = np.array([x, np.cross(z, x), z])
    return Pose(rotation, -rotation @ position)


POSES = [looking(p) for p in ((3.2, -2.4, 1.1), (-2.9, -2.8, 1.6), (0.4, 3.6, 1.3))]


def waved(count=60, seed=0, noise=0.3, places=(0.0, 0.6), cameras=CAMERAS, reach=0.8, turn=None):
    """A bar moved through a volume; all cameras look at its middle."""
    rng = np.random.default_rng(seed)
    d = rng.normal(size=(count, 3)) if turn is None else np.tile(np.asarray(turn, float), (count, 1))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    middle = rng.uniform(-reach, reach, (count, 3))
    rows = []
    for t in range(count):
        for c, (camera, pose) in enumerate(zip(cameras, POSES, strict=False)):
            for m, p in enumerate(places):
                uv = camera.project(pose.apply((middle[t] + (p - np.mean(places)) * d[t])[None]))[0]
                if (uv > 0).all() and (uv < np.array(SIZE)).all():
                    rows.append((c, t, m, *(uv + rng.normal(0, noise, 2))))
    a = np.array(rows)
    whole = a[:, :3].astype(int)
    return Sightings(whole[:, 0], whole[:, 1], whole[:, 2], a[:, 3:], np.array(places))


def unknown(model="opencv4"):
    lens = lenses.make(model)
    return Camera(lens, lens.pinhole(1280, 1280, 639.5, 511.5), SIZE)


def off_by_sigma(found):
    """(estimate - truth) / sigma of all places but the first, and of the free camera parameters."""
    sigma = np.sqrt(np.diagonal(found.covariance))
    begin = sum(f.shape[1] for f in found.frees)
    made = []
    for i in range(1, len(found.wand.poses)):
        truth, ours = POSES[i] @ POSES[0].inverse(), found.wand.poses[i]
        turn = rotations.log(ours.rotation @ truth.rotation.T)
        made.append(np.r_[turn, ours.translation - truth.translation] / sigma[begin + 6 * (i - 1) :][:6])
    for i, camera in enumerate(found.wand.cameras):
        s = np.sqrt(np.diagonal(found.camera_covariance(i)))
        if s.any() and camera.lens.name == "opencv4":
            made.append((camera.params - CAMERAS[i].params) / np.where(s > 0, s, np.inf))
    return np.concatenate(made)


def test_known_cameras_are_placed_to_scale():
    found = estimate(waved(noise=0), CAMERAS, [True] * 3, {}, NAMES)
    for i in (1, 2):
        truth = POSES[i] @ POSES[0].inverse()
        np.testing.assert_allclose(found.wand.poses[i].translation, truth.translation, atol=1e-6)
        np.testing.assert_allclose(found.wand.poses[i].rotation, truth.rotation, atol=1e-7)
    assert found.converged


@pytest.mark.parametrize("known", [True, False])
def test_intervals_hold(known):
    off = []
    for seed in range(6):
        cameras = CAMERAS if known else [unknown()] * 3
        fix = {} if known else {"p1": 0.0, "p2": 0.0}
        off.append(off_by_sigma(estimate(waved(80, seed), cameras, [known] * 3, fix, NAMES)))
    off = np.concatenate(off)
    off = off[off != 0]
    # 72 or more figures: 95 % with three standard deviations of that share
    assert np.mean(np.abs(off) <= 1.96) > 0.87
    assert 0.75 < np.sqrt(np.mean(off**2)) < 1.25


def test_the_focal_length_is_found_where_the_axes_meet():
    """Two cameras that look at one point: fundamental matrices say nothing of f; a bar of one length does."""
    found = estimate(waved(80, cameras=CAMERAS[:2]), [unknown("pinhole")] * 2, [False] * 2, {}, NAMES[:2])
    for camera, truth in zip(found.wand.cameras, CAMERAS, strict=False):
        assert abs(camera.params[0] / truth.params[0] - 1) < 0.05  # distortion is left out


def test_three_markers_and_a_baseline_with_its_sigma():
    found = estimate(waved(places=(0.0, 0.2, 0.6)), CAMERAS, [True] * 3, {}, NAMES)
    length, sigma = found.baseline(0, 2)
    truth = np.linalg.norm(POSES[0].centre - POSES[2].centre)
    assert abs(length - truth) < 4 * sigma and sigma < 0.003


def test_an_uncertain_bar_is_an_uncertain_scale():
    found = estimate(waved(), CAMERAS, [True] * 3, {}, NAMES)
    length, exact = found.baseline(0, 2)
    assert np.isclose(found.with_bar_sigma(0.01).baseline(0, 2)[1], np.hypot(exact, 0.01 * length))
    # translations scale together: the distance of two cameras that are not the reference, too
    length, exact = found.baseline(1, 2)
    assert np.isclose(found.with_bar_sigma(0.01).baseline(1, 2)[1], np.hypot(exact, 0.01 * length))


def test_wrong_tracks_are_left_out():
    seen = waved(80)
    rng = np.random.default_rng(5)
    wrong = rng.random(len(seen)) < 0.1
    seen.uv[wrong] = rng.uniform(0, SIZE, (int(wrong.sum()), 2))
    found = estimate(seen, CAMERAS, [True] * 3, {}, NAMES)
    assert not found.used[wrong].any()
    assert found.used.sum() > 0.6 * len(seen)
    assert np.abs(off_by_sigma(found)).max() < 4.5


def test_exchanged_ends_are_left_out():
    seen = waved(60)
    swapped = (seen.instant < 4) & (seen.camera == 1)
    seen.marker[swapped] = 1 - seen.marker[swapped]
    found = estimate(seen, CAMERAS, [True] * 3, {}, NAMES)
    assert not found.used[swapped].any()
    assert np.abs(off_by_sigma(found)).max() < 4.5


def test_what_is_refused():
    with pytest.raises(DataError, match="no two cameras see 16 markers"):
        estimate(waved(5), CAMERAS, [True] * 3, {}, NAMES)
    alone = waved(60)
    alone.instant[alone.camera == 2] += 1000  # camera c sees other instants than a and b
    with pytest.raises(EstimationError, match="camera c cannot be placed"):
        estimate(alone, CAMERAS, [True] * 3, {}, NAMES)
    # far away and hardly moved, the bar is always seen in one perspective
    still = waved(40, reach=0.02, places=(0.0, 0.05), noise=1.0)
    with pytest.raises(EstimationError, match="undetermined: its standard deviation is"):
        estimate(still, [unknown("pinhole")] * 3, [False] * 3, {}, NAMES)


def written(folder, seen):
    with (folder / "wand.csv").open("w", newline="") as handle:
        writer = csv.writer(handle)
        writer.writerow(["camera", "view", "point", "u", "v"])
        for c, t, m, uv in zip(seen.camera, seen.instant, seen.marker, seen.uv, strict=True):
            writer.writerow([NAMES[c], t, f"m{m}", *map(repr, uv.tolist())])
    return folder / "wand.csv"


def test_command_line(tmp_path):
    run = CliRunner()
    path = written(tmp_path, waved())
    given = [str(path), "--bar", "0.6", "--bar-sigma", "0.003", "-m", "opencv4", "--image-size", "1280x1024"]
    done = run.invoke(camcal, ["wand", *given, "-o", str(tmp_path / "rig.yaml"), "--format", "json"])
    assert done.exit_code == 0, done.output
    found = yaml.safe_load((tmp_path / "rig.yaml").read_text())
    assert abs(found["wand"]["length"]["mean"] - 0.6) < 1e-3 and found["wand"]["length"]["given"] == 0.6
    assert found["verdict"] == "pass" and found["crosscheck"][0]["status"] == "pass"
    truth = np.linalg.norm(POSES[0].centre - POSES[1].centre)
    entry = found["rig"]["baselines"]["a-b"]
    assert abs(entry["value"] - truth) < 4 * entry["sigma"]
    assert found["wand"]["bar_sigma"] == 0.003 and entry["sigma"] >= 0.005 * entry["value"]  # 0.003 of 0.6
    # the rig serves triangulation and becomes DLT coefficients
    points = tmp_path / "points.csv"
    points.write_text("camera,point,u,v\na,p,640,500\nb,p,640,500\nc,p,640,500\n")
    done = run.invoke(camcal, ["triangulate", str(tmp_path / "rig.yaml"), str(points), "--format", "json"])
    assert done.exit_code in (0, 1)
    (middle,) = json.loads(done.stdout)["points"]  # all cameras look there, where the bars are
    assert np.linalg.norm(middle["xyz"]) < 0.2
    given[given.index("opencv4")] = "pinhole"
    assert run.invoke(camcal, ["wand", *given, "-o", str(tmp_path / "p.yaml")]).exit_code == 0
    done = run.invoke(camcal, ["convert", str(tmp_path / "p.yaml"), str(tmp_path / "dlt.csv"), "--to", "dlt"])
    assert done.exit_code == 0, done.output
    assert read_dlt(tmp_path / "dlt.csv").shape == (3, 3, 4)


def test_files_of_dltdv(tmp_path):
    seen = waved(60, cameras=CAMERAS[:2])
    table = np.full((60, 8), np.nan)
    for c, t, m, uv in zip(seen.camera, seen.instant, seen.marker, seen.uv, strict=True):
        table[t, 4 * m + 2 * c : 4 * m + 2 * c + 2] = uv
    head = ",".join(f"pt{p}_cam{c}_{x}" for p in (1, 2) for c in (1, 2) for x in "XY")
    np.savetxt(tmp_path / "xypts.csv", table, delimiter=",", header=head, comments="")
    args = [
        "wand",
        str(tmp_path / "xypts.csv"),
        "--bar",
        "600",
        "--image-size",
        "1280x1024",
        "--format",
        "json",
    ]
    done = CliRunner().invoke(camcal, args)
    assert done.exit_code == 0, done.output
    truth = 1000 * np.linalg.norm(POSES[0].centre - POSES[1].centre)
    assert abs(json.loads(done.stdout)["rig"]["baselines"]["1-2"]["value"] / truth - 1) < 0.05


def test_bad_input_is_named(tmp_path):
    path, run = written(tmp_path, waved()), CliRunner()
    for args, words in (
        (["--bar", "0.6"], "neither the camera 'a' nor the size"),
        (["--bar", "0,0.2,0.6", "--image-size", "1280x1024"], "2 markers"),
        (["--bar", "0.6,0.2", "--image-size", "1280x1024"], "increasing places"),
        (["--bar", "0", "--image-size", "1280x1024"], "increasing places"),
        (["--image-size", "1280x1024"], "--bar"),
        (["--bar", "0.6", "--cameras", "z=z.yaml", "--image-size", "1280x1024"], "--cameras names 'z'"),
    ):
        done = run.invoke(camcal, ["wand", str(path), *args])
        assert done.exit_code != 0 and words in done.output + str(done.exception), args


def test_a_principal_point_that_is_held_is_in_the_sigmas():
    """Camera b's is undetermined here: moved by a standard deviation, it moves the others by less than their sigmas."""
    lens = lenses.make("pinhole")
    cameras = [Camera(lens, np.array([c.params[0]] * 2 + [639.5, 511.5]), SIZE) for c in CAMERAS]
    seen = waved(16, 0, 0.5, (0.0, 0.3), cameras, 0.2)
    found = estimate(seen, [unknown("pinhole")] * 3, [False] * 3, {}, NAMES)
    assert found.assumed == ("b.cx", "b.cy")
    begun = list(found.wand.cameras)
    begun[1] = assumed_centre.moved(begun[1], "cx")
    other = adjust(replace(found.wand, cameras=tuple(begun)), seen.take(found.used), found.frees).state
    sigma = np.sqrt(found.camera_covariance(1)[0, 0])
    by_centre = (other.cameras[1].params[0] - found.wand.cameras[1].params[0]) / assumed_centre.LINEAR
    assert by_centre and sigma > abs(by_centre)
    assert found.camera_covariance(1)[2, 2] == 0


@pytest.mark.parametrize("late", [0, 3])
def test_a_camera_that_is_late_is_refused(late):
    seen = waved(40, places=(0.0, 0.6))
    seen.instant[seen.camera == 1] += late
    seen = seen.take(np.argsort(seen.instant, kind="stable"))
    if not late:
        assert estimate(seen, CAMERAS, [True] * 3, {}, NAMES).used.all()
        return
    with pytest.raises(EstimationError, match="the tracks are not those of a bar"):
        estimate(seen, CAMERAS, [True] * 3, {}, NAMES)


@pytest.mark.parametrize(("size", "warned"), [("1280x1024", False), ("640x512", True)])
def test_tracks_outside_the_picture_are_named(tmp_path, size, warned):
    path, out = written(tmp_path, waved()), tmp_path / "rig.yaml"
    given = ["wand", str(path), "--bar", "0.6", "--image-size", size, "-m", "opencv4", "-o", str(out)]
    assert CliRunner().invoke(camcal, given).exit_code == 0
    codes = [w["code"] for w in yaml.safe_load(out.read_text())["warnings"]]
    assert ("points-outside-image" in codes) == warned
