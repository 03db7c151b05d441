"""The wheel and the source archive: built, installed into an empty environment, and put to the main job."""

import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

from camcal.version import __version__

ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.slow  # downloads the dependencies: a minute


def run(*command, cwd=None):
    env = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
    done = subprocess.run(list(map(str, command)), cwd=cwd, env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    return done


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """A copy of what is in the project, built from there; dist/ stays out of the project."""
    place = tmp_path_factory.mktemp("build")
    names = run("git", "ls-files", "-z", cwd=ROOT).stdout.split("\0")
    for name in filter(None, names):
        if (ROOT / name).exists():
            (place / "src" / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, place / "src" / name)
    run(sys.executable, "-m", "build", "--outdir", place / "dist", place / "src")
    return place / "dist"


def test_what_is_inside(built):
    (wheel,), (archive,) = built.glob("*.whl"), built.glob("*.tar.gz")
    assert wheel.name == f"camcal-{__version__}-py3-none-any.whl"
    names = set(zipfile.ZipFile(wheel).namelist())
    assert {"camcal/__init__.py", "camcal/py.typed"} <= names
    assert any(n.endswith("licenses/LICENSE") for n in names)
    assert not [n for n in names if n.startswith(("tests/", "docs/"))]
    with tarfile.open(archive) as opened:
        inside = {n.partition("/")[2] for n in opened.getnames()}
    assert {"LICENSE", "README.md", "docs/index.md", "tests/test_api.py", "sample_data/rig.csv"} <= inside


def test_the_main_job_from_the_wheel(built, tmp_path):
    (wheel,) = built.glob("*.whl")
    run(sys.executable, "-m", "venv", tmp_path / "venv")
    bin = tmp_path / "venv" / "bin"
    run(bin / "pip", "install", "-q", f"{wheel}[report]")
    assert run(bin / "camcal", "--version", cwd=tmp_path).stdout == f"camcal {__version__}\n"
    board = ROOT / "sample_data" / "board"
    done = run(bin / "camcal", "checkerboard", board, "--square", "25mm", "-o", "camera.yaml", cwd=tmp_path)
    assert "PASS" in done.stderr
    run(bin / "camcal", "report", "camera.yaml", "-o", "camera.html", cwd=tmp_path)
    script = "import camcal; print(camcal.load('camera.yaml').camera.matrix[0, 0])"
    assert 100 < float(run(bin / "python", "-c", script, cwd=tmp_path).stdout) < 10000
