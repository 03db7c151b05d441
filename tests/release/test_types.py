"""The public interface as a user's type checker sees it."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import camcal

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = """
from __future__ import annotations

import numpy as np

import camcal


def focal_length(path: str) -> float:
    data = camcal.read_points(path)
    solution: camcal.Solution = camcal.calibrate(data, model="opencv5", robust="auto")
    if solution.grade == "wrong":
        raise SystemExit("; ".join(w.message for w in solution.warnings))
    solution.save("camera.yaml")
    matrix, distortion = solution.camera.opencv()
    return float(matrix[0, 0]) + float(distortion[0])


def pixel(camera: camcal.Camera, pose: camcal.Pose, xyz: np.ndarray) -> np.ndarray:
    return camera.project(pose.apply(xyz))


def centre(path: str) -> np.ndarray:
    found = camcal.load(path)
    if isinstance(found, camcal.Solution):
        found = found.camera
    if isinstance(found, camcal.Camera):
        return found.unproject(np.array([found.matrix[0, 2], found.matrix[1, 2]]))
    raise TypeError(path)


def pair(path: str) -> tuple[float, camcal.Pose]:
    rig = camcal.load(path)
    assert isinstance(rig, camcal.Rig)
    return rig.baseline("left", "right"), rig.relative("right", "left")


def made(xyz: np.ndarray, uv: np.ndarray) -> camcal.Observations:
    return camcal.Correspondences.from_views([(xyz, uv)], image_size=(640, 480))


def of_pictures() -> str:
    return camcal.calibrate_images(["pictures"], square="25mm").verdict
"""


#: what the interface does not have: the types are there, or nobody would notice
WRONG = """

def wrong(solution: camcal.Solution, rig: camcal.Rig) -> float:
    solution.save_all(3)
    return rig.baseline("left", 3)
"""


def test_a_users_script_passes_strict_checks_and_a_wrong_one_does_not(tmp_path):
    file = tmp_path / "user.py"
    file.write_text(SCRIPT + WRONG)
    # camcal's own modules are followed, but not reported on, as those of installed packages
    command = [
        sys.executable,
        "-m",
        "mypy",
        "--strict",
        "--follow-imports=silent",
        "--no-incremental",
        "user.py",
    ]
    env = {"MYPYPATH": str(ROOT), "PATH": os.environ["PATH"]}
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, env=env)
    found = [line.split(":")[1] for line in done.stdout.splitlines() if ": error:" in line]
    lines = file.read_text().splitlines()
    expected = [str(i) for i, line in enumerate(lines, 1) if "save_all" in line or '"left", 3' in line]
    assert found == expected, done.stdout + done.stderr


def test_type_checkers_see_every_public_name():
    source = Path(camcal.__file__).read_text(encoding="utf-8")
    (block,) = (node for node in ast.parse(source).body if isinstance(node, ast.If))
    seen = {f"{part.module}:{a.name}" for part in block.body for a in part.names if a.asname == a.name}
    assert seen == set(camcal._PUBLIC.values())
    assert (Path(camcal.__file__).parent / "py.typed").exists()
