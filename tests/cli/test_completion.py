"""The shell's completion: its scripts, and what it offers."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from tests.cli.conftest import SAMPLES

ROOT = SAMPLES.parent


def offered(*words):
    """What bash gets for the last word of a line."""
    line = " ".join(("camcal", *words))
    env = {**os.environ, "PYTHONPATH": str(ROOT), "_CAMCAL_COMPLETE": "bash_complete"}
    env |= {"COMP_WORDS": line, "COMP_CWORD": str(len(words))}
    done = subprocess.run([sys.executable, "-m", "camcal"], env=env, capture_output=True, text=True)
    assert done.stderr == ""
    return [tuple(item.split(",", 1)) for item in done.stdout.splitlines()]


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_each_shell_has_a_script(shell):
    env = {**os.environ, "PYTHONPATH": str(ROOT), "_CAMCAL_COMPLETE": f"{shell}_source"}
    done = subprocess.run([sys.executable, "-m", "camcal"], env=env, capture_output=True, text=True)
    assert done.returncode == 0 and "_CAMCAL_COMPLETE" in done.stdout and "camcal" in done.stdout
    assert f"_CAMCAL_COMPLETE={shell}_source" in (ROOT / "docs" / "installation.md").read_text("utf-8")


def test_commands_options_names_and_files():
    assert ("plain", "rectify") in offered("rec")
    assert ("plain", "--alpha") in offered("rectify", "--al")
    assert {"opencv4", "opencv5", "opencv8"} <= {n for _, n in offered("estimate", "-m", "opencv")}
    assert ("plain", "kalibr") in offered("convert", "a.yml", "--to", "kal")
    assert [kind for kind, _ in offered("evaluate", "cam")] == ["file"]


def test_cameras():
    from camcal.data.formats import write
    from camcal.data.formats.base import CameraFile, NamedCamera
    from camcal.model import lenses
    from camcal.model.camera import Camera
    from camcal.model.pose import Pose

    lens = lenses.make("pinhole")
    camera = Camera(lens, lens.pinhole(500.0, 500.0, 319.5, 239.5), (640, 480))
    write("pair.yml", CameraFile(tuple(NamedCamera(n, camera, Pose.identity()) for n in ("left", "right"))))
    assert offered("convert", "pair.yml", "out.yml", "--camera", "r") == [("plain", "right")]
    assert offered("rig", "front=a", "back=b", "--reference", "") == [("plain", "front"), ("plain", "back")]
    assert offered("rig", "front=a", "back=b", "--hold", "front,b") == [("plain", "front,back")]
    Path("camcal.yaml").write_text(yaml.safe_dump({}))
    assert offered("convert", "absent.yml", "--camera", "") == [("",)]
