"""Simulated data: poses that keep the object in the picture, noise as asked, the sample data made again."""

import re
import shlex
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from camcal.cli.boundary import run
from camcal.detect import targets
from camcal.errors import UsageError
from camcal.geometry import rotations
from camcal.model.placement import Spread, simulate_poses
from camcal.model.pose import Pose, Poses
from camcal.study.cameras import example_camera
from camcal.study.pictures import board_poses, bowed_sheet
from camcal.study.points import corner_rig, facing_corner, simulate_points

ROOT = Path(__file__).resolve().parents[2]
SAMPLES = ROOT / "sample_data"
COMMANDS = re.findall(r"^camcal (simulate .*)$", (SAMPLES / "README.md").read_text(), re.MULTILINE)


def table(path):
    return np.loadtxt(path, delimiter=",", skiprows=1, usecols=range(1, 7))


def camera_of(document):
    values = {name: entry["value"] for name, entry in document["camera"]["parameters"].items()}
    return example_camera(
        document["camera"]["model"], document["camera"]["image_size"], values, "skew" in values
    )


def poses_of(document):
    found = [view["cam_from_board"] for view in document["views"]]
    return [Pose(rotations.exp(np.array(p["rotation_vector"])), np.array(p["translation"])) for p in found]


# ------------------------------------------------------------------------------------------ the sample data
def made_again(command, folder, extra=()):
    """Run a command of the README with its output in another folder; the output."""
    words = shlex.split(command)
    where = words.index("-o") + 1
    output = folder / Path(words[where]).name
    words[where] = str(output)
    words = [str(ROOT / w) if w.startswith("sample_data/") else w for w in words]
    assert run([*words, *extra]) == 0
    return output


@pytest.mark.parametrize("name", ["rig.csv", "barranco_medel.csv"])
def test_sample_points_are_made_again(name, tmp_path):
    command = next(c for c in COMMANDS if c.endswith(name))
    again = made_again(command, tmp_path)
    assert again.read_text().splitlines()[0] == (SAMPLES / name).read_text().splitlines()[0]
    # written with 10 decimals; another processor may round the last one differently
    assert np.abs(table(again) - table(SAMPLES / name)).max() < 2e-10
    truth = yaml.safe_load((SAMPLES / name).with_suffix(".truth.yaml").read_text())
    assert (
        yaml.safe_load((tmp_path / name).with_suffix(".truth.yaml").read_text())["camera"] == truth["camera"]
    )


def test_sample_pictures_are_made_again(tmp_path):
    """The truth of all views, and one picture to within what two JPEG encoders may differ by."""
    command = next(c for c in COMMANDS if "images" in c)
    again = made_again(command, tmp_path)
    mine, kept = (
        yaml.safe_load((folder / "truth.yaml").read_text()) for folder in (again, SAMPLES / "board")
    )
    assert mine["camera"] == kept["camera"]
    for a, b in zip(mine["views"], kept["views"], strict=True):
        assert a["id"] == b["id"]
        for part in ("rotation_vector", "translation"):
            # the last digits of a product depend on the processor, and on how many poses are tried at a time
            pair = a["cam_from_board"][part], b["cam_from_board"][part]
            np.testing.assert_allclose(*pair, rtol=1e-12, atol=1e-12)
    for name in ("view01.jpg", "view12.jpg"):
        pair = [
            cv2.imread(str(folder / name), cv2.IMREAD_GRAYSCALE).astype(float)
            for folder in (again, SAMPLES / "board")
        ]
        assert np.abs(pair[0] - pair[1]).mean() < 0.5


def test_sample_pictures_show_what_the_truth_says():
    truth = yaml.safe_load((SAMPLES / "board" / "truth.yaml").read_text())
    target, camera = targets.make("checkerboard:9x6:25mm"), camera_of(truth)
    for view, cam_from_board in zip(truth["views"], poses_of(truth), strict=True):
        found = target.find(
            cv2.imread(str(SAMPLES / "board" / view["id"]), cv2.IMREAD_GRAYSCALE), seconds=20.0
        )
        uv = camera.project(cam_from_board.apply(target.points))
        off = np.linalg.norm(found.uv - uv[found.point_ids], axis=1)
        assert (
            len(found) == 54 and np.median(off) < 0.05
        )  # .01 measured; a picture with the wrong truth: 100 px


def test_sample_data_stays_small():
    sizes = [path.stat().st_size for path in SAMPLES.rglob("*") if path.is_file()]
    assert sum(sizes) < 1.5e6


def test_papers_points():
    """The image points printed in the paper, to its four digits (times 1e4), in their order."""
    uv = table(SAMPLES / "barranco_medel.csv")[:, -2:]
    assert (uv[:2] / 1e4).round(4).tolist() == [[0.0632, 0.0571], [0.0743, 0.4079]]


# ------------------------------------------------------------------------------------------ poses
@pytest.mark.parametrize("model", ["pinhole", "opencv5", "opencv8"])
def test_poses_keep_the_board_in_the_picture(model):
    camera, target, rng = (
        example_camera(model),
        targets.make("checkerboard:9x6:25mm"),
        np.random.default_rng(0),
    )
    spread = Spread(tilt=(10.0, 50.0), fill=(0.4, 0.8), roll=30.0)
    poses = board_poses(target, camera, rng, 20, spread)
    middles, tilts = [], []
    for pose in poses:
        uv = camera.project(pose.apply(target.points))
        assert (uv > -0.5).all() and (uv < np.array(camera.image_size) - 0.5).all()
        sight = pose.apply(target.points.mean(0))
        tilts.append(np.degrees(np.arccos(pose.rotation[:, 2] @ sight / np.linalg.norm(sight))))
        middles.append(uv.mean(0))
    assert min(tilts) > 5.0 and max(tilts) > 40.0 and max(tilts) < 56.0
    # spread over the picture: the middles reach into each third of it
    for axis in (0, 1):
        thirds = np.floor(3 * np.array(middles)[:, axis] / camera.image_size[axis])
        assert set(thirds) == {0.0, 1.0, 2.0}


def test_impossible_poses_are_said():
    camera, rng = example_camera("opencv5"), np.random.default_rng(0)
    with pytest.raises(UsageError, match="no pose shows the whole object at 300%") as error:
        simulate_poses(corner_rig(), camera, rng, 1, Spread(fill=(3.0, 3.0)))
    assert "--fill" in error.value.hint


def test_rigs():
    corner = corner_rig(4, 30.0)
    assert corner.shape == (48, 3) and len(np.unique(corner, axis=0)) == 48
    assert ((corner == 0).sum(1) == 1).all()  # each on one face, none on an edge
    r = facing_corner()
    assert (
        np.linalg.det(r) == pytest.approx(1.0) and (r @ [0, 0, 1])[1] < 0
    )  # z of the rig is up, so v decreases
    camera = example_camera("opencv5")
    for pose in simulate_poses(corner, camera, np.random.default_rng(1), 5, Spread(tilt=(0, 20)), r):
        assert (pose.inverse().translation > 0).all()  # all three faces are seen from their inner side


# ------------------------------------------------------------------------------------------ points
def test_noise_and_outliers_are_as_asked():
    camera, rng = example_camera("opencv5"), np.random.default_rng(0)
    points = targets.make("checkerboard:20x20:5mm").points
    poses = simulate_poses(points, camera, rng, 10)
    clean = simulate_points(camera, points, poses, rng)
    noisy = simulate_points(camera, points, poses, rng, noise=0.3)
    dirty = simulate_points(camera, points, poses, rng, outliers=0.1)
    noise = np.concatenate([a.uv - b.uv for a, b in zip(noisy.views, clean.views, strict=True)])
    assert noise.std() == pytest.approx(0.3, rel=0.05)  # 8000 numbers: known to 0.8 %
    moved = np.concatenate(
        [np.linalg.norm(a.uv - b.uv, axis=1) for a, b in zip(dirty.views, clean.views, strict=True)]
    )
    assert (moved > 0).mean() == pytest.approx(0.1) and moved[moved > 0].min() >= 5 and moved.max() <= 60


def test_points_outside_are_left_out():
    camera, rng = example_camera("pinhole", (640, 480)), np.random.default_rng(0)
    points = np.array([[0.0, 0, 0], [10.0, 0, 0], [0, 0, -9.0]])
    poses = Poses.stack([Pose(np.eye(3), np.array([0.0, 0, 5.0]))])
    assert simulate_points(camera, points, poses, rng).views[0].point_ids.tolist() == [0]
    assert simulate_points(camera, points, poses, rng, clip=False).views[0].point_ids.tolist() == [0, 1]


def test_bowed_sheet():
    target = targets.make("checkerboard:9x6:25mm")
    x0, y0, x1, _ = target.pattern().extent
    height = bowed_sheet(target, 4.0)
    assert height(np.array([[x0, y0], [(x0 + x1) / 2, 0.0], [x1, 0.0]])) == pytest.approx([0.0, -4.0, 0.0])


def test_example_camera_at_another_size_sees_the_same():
    small, large = example_camera("opencv5", (640, 480)), example_camera("opencv5", (1280, 960))
    point = np.array([0.2, -0.1, 1.0])
    assert (large.project(point) + 0.5) / 2 == pytest.approx(small.project(point) + 0.5, abs=1e-9)


# ------------------------------------------------------------------------------------------ the command
def test_points_command(tmp_path):
    out = tmp_path / "p.csv"
    options = [
        "--views",
        "4",
        "--noise",
        "0.2",
        "--target",
        "charuco:6x5:30mm:20mm:4X4_50",
        "-o",
        str(out),
        "-q",
    ]
    assert run(["simulate", "points", *options]) == 0
    first = out.read_bytes()
    assert run(["simulate", "points", *options]) == 2  # exists
    assert run(["simulate", "points", *options, "--force"]) == 0 and out.read_bytes() == first
    assert run(["simulate", "points", *options, "--force", "--seed", "1"]) == 0 and out.read_bytes() != first
    document = yaml.safe_load((tmp_path / "p.truth.yaml").read_text())
    assert document["schema"] == "camcal-truth/1" and document["seed"] == 1
    from camcal.data.points import read_points

    found, camera = read_points(out), camera_of(document)
    residuals = [
        v.uv - camera.project(p.apply(v.xyz)) for v, p in zip(found.views, poses_of(document), strict=True)
    ]
    assert np.concatenate(residuals).std() == pytest.approx(0.2, rel=0.15)  # 160 numbers: known to 5.6 %


def test_images_command(tmp_path):
    out = tmp_path / "pictures"
    options = ["--views", "2", "--image-size", "320x240", "--bits", "16", "-o", str(out), "-q"]
    assert run(["simulate", "images", *options]) == 0
    assert sorted(p.name for p in out.iterdir()) == ["truth.yaml", "view01.png", "view02.png"]
    picture = cv2.imread(str(out / "view01.png"), cv2.IMREAD_UNCHANGED)
    assert picture.dtype == np.uint16 and picture.shape == (240, 320)
    assert run(["simulate", "images", *options]) == 2


@pytest.mark.parametrize(
    "words",
    [
        ["points", "--tilt", "5"],
        ["points", "--set", "banana=3"],
        ["rig", "--frame", "camera", "--points3d", str(SAMPLES / "barranco_medel_camera_frame.csv")],
        ["rig", "--pose", "1,2,3"],
        ["images", "--bits", "16", "--type", "jpg"],
        ["points", "--fill", "5,6"],
    ],
)
def test_contradictions_are_refused(words, tmp_path, capsys):
    assert run(["simulate", *words, "-o", str(tmp_path / "x.csv")]) == 2
    assert "Traceback" not in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
