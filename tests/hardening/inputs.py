"""Small inputs of every kind, made by camcal itself, in a folder: what the fuzz and the fault tests begin from."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path

import numpy as np
import yaml

from camcal.geometry import rotations
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from tests.data.corner_samples import samples

SAMPLES = Path(__file__).resolve().parents[2] / "sample_data"
SIZE = (640, 480)


def write_rows(path: Path, header: str, rows) -> None:
    with path.open("w", newline="") as stream:
        csv.writer(stream).writerows([header.split(","), *rows])


def make(folder: Path, camcal) -> None:
    """Fill a folder; `camcal(*args)` runs a command line there and returns its exit code."""
    (folder / "board").mkdir()
    for picture in sorted((SAMPLES / "board").glob("*.jpg"))[:4]:
        shutil.copyfile(picture, folder / "board" / picture.name)
    _rig(folder)
    for name, args in {
        "p.csv": ["simulate", "points", "--views", "5"],
        "f.csv": ["simulate", "frames", "--frames", "12", "--points", "12"],
        "r.yaml": ["estimate", "p.csv", "--image-size", "640x480", "-m", "opencv4", "--no-crosscheck"],
        "rig.yaml": ["rig", "rig.csv", "--image-size", "640x480", "-m", "pinhole", "--no-crosscheck"],
        "points.npz": ["detect", "board"],
        "points.vnl": ["detect", "board"],
    }.items():
        camcal(*args, "-o", name)
    (folder / "one").mkdir()
    shutil.copyfile(
        folder / "board" / next(iter(sorted((folder / "board").iterdir()))).name, folder / "one/a.jpg"
    )
    _tables(folder)
    camcal("hand-eye", "r.yaml", "--poses", "poses.csv", "-o", "h.yaml")
    _corners_of_others(folder)


def _corners_of_others(folder: Path) -> None:
    """Corners as other programs write them, with the files beside them that their readers need."""
    from tests.data import corner_samples as samples

    (folder / "corners.orpc").write_text(samples.ORPC)
    (folder / "boards.dsc").write_text(samples.dsc())
    (folder / "boards.tp").write_text(samples.TP)
    (folder / "corners.mat").write_bytes(samples.tartan_corners())
    (folder / "board.mat").write_bytes(samples.tartan_board())
    (folder / "corners.bin").write_bytes(samples.dataset(samples.tartan_pictures()))
    (folder / "calibio.json").write_text(samples.calibio())
    (folder / "photomodeler.txt").write_text(samples.photomodeler(samples.MARKS))
    (folder / "photonvision.json").write_text(json.dumps(samples.PHOTONVISION))
    (folder / "sample.yml").write_text(samples.OPENCV)


def _rig(folder: Path) -> None:
    """Two cameras that see a board in six poses."""
    rng = np.random.default_rng(1)
    ideal = Camera(lenses.make("pinhole"), np.array([500.0, 500, 320, 240]), SIZE)
    x, y = np.meshgrid(np.arange(6.0), np.arange(5.0))
    board = np.c_[x.ravel() - 2.5, y.ravel() - 2, np.zeros(30)]
    rows = []
    for view in range(6):
        turn = rotations.exp(rng.uniform(-0.5, 0.5, 3))
        shift = np.array([*rng.uniform(-0.5, 0.5, 2), rng.uniform(9, 11)])
        for name, baseline in (("left", 0.0), ("right", -1.0)):
            uv = ideal.project(board @ turn.T + shift + [baseline, 0, 0]) + rng.normal(0, 0.1, (30, 2))
            rows += [[name, view, *p, *q] for p, q in zip(board.tolist(), uv.tolist(), strict=True)]
    write_rows(folder / "rig.csv", "camera,view,X,Y,Z,u,v", rows)


def _robot(folder: Path) -> None:
    """base_from_hand of a robot that carried the camera of r.yaml."""
    report = yaml.safe_load((folder / "r.yaml").read_text())
    rng = np.random.default_rng(2)
    hand_from_camera = Pose(rotations.exp(np.array([0.2, -0.1, 0.3])), np.array([20.0, 30, 40]))
    rows = []
    for view in report["views"]:
        given = view["cam_from_board"]
        seen = Pose(rotations.exp(np.array(given["rotation_vector"])), np.array(given["translation"]))
        base_from_hand = seen.inverse() @ hand_from_camera.inverse()
        shift = base_from_hand.translation + rng.normal(0, 0.1, 3)
        rows.append([view["id"], *shift, *rotations.log(base_from_hand.rotation)])
    write_rows(folder / "poses.csv", "view,x,y,z,rx,ry,rz", rows)


def _tables(folder: Path) -> None:
    rng = np.random.default_rng(0)
    lens = lenses.make("opencv4")
    camera = Camera(lens, np.array([500.0, 500, 320, 240, -0.2, 0.05, 0, 0]), SIZE)
    lines = []
    for i in range(16):
        angle, offset = np.pi * i / 16, rng.uniform(-120, 120)
        along = np.linspace(-180, 180, 15)
        x = (along * np.cos(angle) - offset * np.sin(angle)) / 500
        y = (along * np.sin(angle) + offset * np.cos(angle)) / 500
        uv = camera.project(np.c_[x, y, np.ones(15)])
        lines += [[i, *p] for p in uv.tolist()]
    write_rows(folder / "lines.csv", "line,u,v", lines)
    world = rng.uniform(-1, 1, (40, 3))
    ideal = Camera(lenses.make("pinhole"), np.array([500.0, 500, 320, 240]), SIZE)
    tracks, points2d, matrices = [], [], []
    for view in range(6):
        turn = rotations.exp(np.array([0.15 * view, -0.35 * view + 0.4, 0.4 * view]))
        shift = np.array([0.1 * view, -0.1, 4.5 + 0.2 * view])
        uv = ideal.project(world @ turn.T + shift) + rng.normal(0, 0.1, (40, 2))
        tracks += [[view, i, *p] for i, p in enumerate(uv.tolist())]
        matrices.append(ideal.matrix @ np.c_[turn, shift])
        points2d += [[view + 1, i, *p] for i, p in enumerate(uv.tolist())]
    write_rows(folder / "tracks.csv", "view,point,u,v", tracks)
    bars, ways = [], np.random.default_rng(1).normal(size=(40, 3))
    for view, m in enumerate(matrices[:3]):
        for instant, (end, way) in enumerate(zip(world, ways, strict=True)):
            for marker, xyz in enumerate((end, end + 0.5 * way / np.linalg.norm(way))):
                q = m @ np.r_[xyz, 1]
                bars.append([view, instant, marker, *(q[:2] / q[2])])
    write_rows(folder / "wand.csv", "camera,view,point,u,v", bars)
    write_rows(folder / "points2d.csv", "camera,point,u,v", [r for r in points2d if r[0] < 4])
    dlt = np.stack([(m / m[2, 3]).ravel()[:11] for m in matrices[:3]], 1)
    np.savetxt(folder / "dlt.csv", dlt, delimiter=",")
    uv = camera.project(world @ turn.T + shift)
    write_rows(folder / "pose.csv", "X,Y,Z,u,v", np.c_[world, uv].tolist())
    u, v = np.meshgrid(np.linspace(0, 639, 9), np.linspace(0, 479, 7))
    rays = camera.unproject(np.c_[u.ravel(), v.ravel()])
    write_rows(
        folder / "pairs.csv", "x,y,u,v", np.c_[rays[:, :2] / rays[:, 2:], u.ravel(), v.ravel()].tolist()
    )
    room = []
    for i, axis in enumerate([0, 1, 2] * 12):
        start = rng.uniform(-2, 2, 3)
        xyz = start + np.linspace(0, 1.2, 5)[:, None] * np.eye(3)[axis]
        uv = ideal.project(xyz @ rotations.exp(np.array([0.3, 0.5, 0.1])).T + [0, 0, 7])
        room += [[i, *p] for p in uv.tolist()]
    write_rows(folder / "room.csv", "line,u,v", room)
    _robot(folder)
    (folder / "jobs.yaml").write_text(
        "jobs:\n- {name: a, points: p.csv, image-size: 640x480, model: pinhole}\n"
    )
    (folder / "camcal.yml").write_text("model: opencv8\nestimate:\n  max-rms: 0.5\n")
    (folder / "april.yaml").write_text(
        "target_type: 'aprilgrid'\ntagCols: 6\ntagRows: 6\ntagSize: 0.022\ntagSpacing: 0.3\n"
    )
    for name, (file, content, beside) in samples().items():
        (folder / f"of-{name}").mkdir()
        for other, data in {file: content, **beside}.items():
            (folder / f"of-{name}" / other).write_bytes(data)
    np.savetxt(folder / "p3.csv", world, delimiter=",", header="X,Y,Z", comments="")
