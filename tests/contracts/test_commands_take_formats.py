"""Every command that takes a camera takes a file of every format, as it is.

The commands are found in the table: one that takes a camera and is not tried here fails the test.
"""

from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from camcal.cli.boundary import run
from camcal.data.formats import FORMATS, files
from camcal.data.formats.base import CameraFile, NamedCamera
from camcal.data.formats.terms import room
from camcal.geometry import rotations
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from camcal.report.camera import cameras_document
from camcal.report.document import save
from camcal.settings.commands import OPTIONS
from tests.solved import grid

SIZE = (640, 480)
#: cam_from_rig; the DLT needs the world's origin before the camera
PLACE = Pose(np.eye(3), np.array([0.0, 0.0, 1.0]))
#: arguments or options of a command that are a camera or a rig
TAKES = {
    "evaluate": "CAMERA",
    "compare": "A, B",
    "pose": "CAMERA",
    "convert": "SRC",
    "undistort": "--camera",
    "track": "--camera",
    "hand-eye": "--camera",
    "estimate": "--start-camera, --distortion",
    "checkerboard": "--start-camera",
    "rig": "--cameras",
    "wand": "--cameras",
    "rectify": "RIG",
    "triangulate": "CAMERAS",
}
#: commands that load the camera by the call of one that is tried: of pictures as `estimate`, `hand-eye` as `pose`
SAME = {"images", "batch", "watch", "checkerboard", "hand-eye"}
NAMES = ("camera", "start_camera", "distortion", "cameras")


def lens_of(name):
    """A lens that a format holds: an ordinary one where it can."""
    specs = [m for m in files.named_format(name).models or ("opencv5",) if room(m).kind == "polynomial"]
    place = room((specs or list(files.named_format(name).models))[-1])
    return lenses.make(place.spec)


#: an ordinary camera, in the terms that a lens has
VALUES = {
    "fx": 500.0,
    "fy": 500.0,
    "cx": 320.5,
    "cy": 238.5,
    "k1": -0.12,
    "k2": 0.03,
    "p1": 0.001,
    "p2": -0.0005,
}


def camera_of(name):
    lens = lens_of(name)
    return Camera(lens, lens.from_values({n: VALUES.get(n, 0.0) for n in lens.names}), SIZE)


def rig_of(name):
    camera = camera_of(name)
    poses = {
        "1": PLACE,
        "2": Pose(rotations.exp(np.array([0.0, 0.02, 0])), np.array([-1.0, 0.0, 1.0])),
    }
    return CameraFile(tuple(NamedCamera(n, camera, p) for n, p in poses.items()))


def write(path, name, cameras):
    """A file of a format, and the options that its reader needs."""
    form = files.named_format(name)
    if name == "camcal":
        save(cameras_document(cameras), path, force=True)
    else:
        files.write(path, cameras, name, force=True)
    return [] if form.size else ["--image-size", f"{SIZE[0]}x{SIZE[1]}"]


@pytest.fixture
def call(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for place in ("XDG_STATE_HOME", "XDG_CACHE_HOME"):
        monkeypatch.setenv(place, str(tmp_path / place))

    def made(*args, codes=(0,)):
        code = run([str(a) for a in args])
        said = capsys.readouterr()
        assert code in codes, f"camcal {' '.join(map(str, args))}: {code}\n{said.err}"
        return said

    return made


def table(path, rows, header):
    path.write_text(header + "\n" + "".join(",".join(map(str, r)) + "\n" for r in rows))


def board_views(camera, poses, count=6):
    xyz, rng = grid(), np.random.default_rng(3)
    rows = []
    for i in range(count):
        turn = rotations.exp(np.r_[rng.uniform(-0.4, 0.4, 2), rng.uniform(-0.2, 0.2)])
        shift = np.array([*rng.uniform(-1, 1, 2), rng.uniform(12, 14)]) - turn @ xyz.mean(0)
        for name, pose in poses.items():
            uv = camera.project(pose.apply(xyz @ turn.T + shift)) + rng.normal(0, 0.05, (len(xyz), 2))
            rows += [(name, f"v{i}", *p, *q, k) for k, (p, q) in enumerate(zip(xyz, uv, strict=True))]
    return rows


def test_the_table_of_commands():
    found = {c for c, options in OPTIONS.items() if any(o.name in NAMES for o in options)}
    arguments = {"evaluate", "compare", "pose", "convert", "rectify", "triangulate"}
    assert (found | arguments) - SAME <= set(TAKES), "a command takes a camera and is not tried here"


@pytest.mark.parametrize("name", FORMATS)
def test_one_camera(call, tmp_path, name):
    camera = camera_of(name)
    file = tmp_path / f"cam{files.named_format(name).endings[0]}"
    size = write(file, name, CameraFile((NamedCamera("camera", camera, PLACE),)))
    rows = board_views(camera, {"1": Pose.identity()})
    table(tmp_path / "p.csv", [r[1:] for r in rows], "view,X,Y,Z,u,v,id")
    table(tmp_path / "one.csv", [r[2:7] for r in rows if r[1] == "v0"], "X,Y,Z,u,v")
    call("convert", file, "other.yaml", *size)
    # what the file holds is what all commands see: the pose, the residuals and the picture of camcal's own report
    call("compare", file, "other.yaml", "--max-px", "1e-6", *size)
    call("evaluate", file, "p.csv", "-o", "e.yaml", *size, codes=(0, 1))
    assert yaml.safe_load(Path("e.yaml").read_text())["fit"]["rms_point"] < 0.1
    call("pose", file, "one.csv", "--no-crosscheck", "-o", "q.yaml")
    picture = np.random.default_rng(1).integers(0, 255, (SIZE[1], SIZE[0]), np.uint8)
    cv2.imwrite("a.png", picture)
    for place, source, more in (("u1", file, size), ("u2", "other.yaml", [])):
        call("undistort", "-c", source, "a.png", "-o", place, *more)
    assert np.array_equal(cv2.imread("u1/a.png"), cv2.imread("u2/a.png"))
    frames = [(0, *r[2:7], r[7]) for r in rows if r[1] == "v0"]
    table(tmp_path / "f.csv", frames, "frame,X,Y,Z,u,v,id")
    call("track", "f.csv", "--method", "iekf", "--camera", file, "--fix", "intrinsics", "-o", "t.csv")


@pytest.mark.parametrize("name", FORMATS)
def test_a_start(call, tmp_path, name):
    """Where a calibration begins, and whose intrinsics a rig holds."""
    camera = camera_of(name)
    file = tmp_path / f"cam{files.named_format(name).endings[0]}"
    write(file, name, CameraFile((NamedCamera("camera", camera, PLACE),)))
    rows = board_views(camera, {"1": Pose.identity(), "2": Pose(np.eye(3), np.array([-1.0, 0, 0]))})
    table(tmp_path / "p.csv", [r[1:] for r in rows if r[0] == "1"], "view,X,Y,Z,u,v,id")
    quick = ["--image-size", "640x480", "--no-crosscheck", "--holdout", "0"]
    call("estimate", "p.csv", *quick, "-m", "opencv4", "--start-camera", file, "-o", "s.yaml", codes=(0, 1))
    assert yaml.safe_load(Path("s.yaml").read_text())["stages"][0]["name"] == "given"
    table(tmp_path / "rig.csv", rows, "camera,view,X,Y,Z,u,v,id")
    held = ["--cameras", f"1={file},2={file}", "--hold", "1,2"]
    call("rig", "rig.csv", *quick, *held, "-o", "rig.yaml", codes=(0, 1))
    found = yaml.safe_load(Path("rig.yaml").read_text())["cameras"]["2"]["parameters"]
    assert found["fx"]["value"] == pytest.approx(500.0, abs=1e-9) and found["fx"]["fixed"]


@pytest.mark.parametrize("name", FORMATS)
def test_a_wand(call, tmp_path, name):
    camera, rng = camera_of(name), np.random.default_rng(5)
    file = tmp_path / f"cam{files.named_format(name).endings[0]}"
    write(file, name, CameraFile((NamedCamera("camera", camera, PLACE),)))
    poses = {
        "1": Pose.identity(),
        "2": Pose(rotations.exp(np.array([0.0, 0.1, 0.0])), np.array([-1.0, 0.0, 0.1])),
    }
    rows = []
    for view in range(20):
        middle, along = rng.uniform(-1, 1, 3) + [0.3, 0, 6], rng.normal(size=3)
        ends = middle + np.outer([-0.25, 0.25], along / np.linalg.norm(along))
        for own, pose in poses.items():
            rows += [(own, view, p, *q) for p, q in zip("ab", camera.project(pose.apply(ends)), strict=True)]
    table(tmp_path / "w.csv", rows, "camera,view,point,u,v")
    known = ["--cameras", f"1={file},2={file}", "--image-size", "640x480"]
    call("wand", "w.csv", "--bar", "0.5", *known, "--no-crosscheck", "-o", "w.yaml", codes=(0, 1))
    assert yaml.safe_load(Path("w.yaml").read_text())["fit"]["rms_point"] < 1e-6


@pytest.mark.parametrize("name", [f.name for f in files.formats() if f.several and f.poses])
def test_a_rig(call, tmp_path, name):
    cameras = rig_of(name)
    file = tmp_path / f"rig{files.named_format(name).endings[0]}"
    size = write(file, name, cameras)
    names = files.read(file).names
    poses = {n: c.pose for n, c in zip(names, cameras.cameras, strict=True)}
    rows = board_views(cameras.cameras[0].camera, poses, count=2)
    table(tmp_path / "p.csv", rows, "camera,view,X,Y,Z,u,v,id")
    if name != "pix4d":  # its entries are pictures of one camera, not a rig
        call("evaluate", file, "p.csv", "-o", "e.yaml", *size, codes=(0, 1))
        assert yaml.safe_load(Path("e.yaml").read_text())["fit"]["rms_point"] < 0.1
    points = [(r[0], f"p{r[7]}", r[5], r[6]) for r in rows if r[1] == "v0"]
    table(tmp_path / "p2.csv", points, "camera,point,u,v")
    call("triangulate", file, "p2.csv", "-o", "x.csv")
    picture = np.random.default_rng(1).integers(0, 255, (SIZE[1], SIZE[0]), np.uint8)
    cv2.imwrite("a.png", picture)
    call("convert", file, "known.yaml", *size)
    source = "known.yaml" if size else file  # `rectify` has no --image-size
    call("rectify", source, f"{names[0]}=a.png", f"{names[1]}=a.png", "-o", "r")
