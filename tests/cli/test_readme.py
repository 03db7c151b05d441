"""What the README shows works: its commands on the sample data, its Python, its two commands for .ci/run."""

import re
import shlex
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
BLOCKS = re.findall(r"^```(\w*)\n(.*?)^```", (ROOT / "README.md").read_text(encoding="utf-8"), re.M | re.S)
SHELL = [text for kind, text in BLOCKS if kind == "sh"]
PYTHON = [text for kind, text in BLOCKS if kind == "python"]
#: `camcal ...` lines without placeholders (IMAGES, POINTS): these can be run as they stand
COMMANDS = [
    line.split("#")[0].strip()
    for text in SHELL[2:]
    for line in text.splitlines()
    if line.startswith("camcal ") and not re.search(r"\b[A-Z]{4,}\b", line)
]


@pytest.fixture
def place():
    """The folder of the test with what a fresh clone has."""
    for name in ("sample_data", "configs"):
        Path(name).symlink_to(ROOT / name)


def test_starts_with_the_two_commands():
    """`.ci/run` takes the first two code blocks: one command each, the main job and the tests."""
    assert [len(text.splitlines()) for text in SHELL[:2]] == [1, 1]
    for text, start, end in zip(
        SHELL,
        ("pip install '.[report]'", "pip install -e '.[all]'"),
        ("camcal checkerboard", "pytest"),
        strict=False,
    ):
        parts = text.strip().split(" && ")
        assert parts[0] == "python3 -m venv .venv"
        assert parts[1] == f".venv/bin/{start}"
        assert end in parts[-1]


def test_there_are_commands_to_test():
    assert len(COMMANDS) >= 2


@pytest.mark.parametrize("line", [SHELL[0].rpartition("&& .venv/bin/")[2].strip(), *COMMANDS])
def test_command(camcal, place, line):
    program, *args = shlex.split(line)
    assert program == "camcal"
    code, out, err = camcal(*args)
    assert code == 0, err
    assert out
    assert "PASS" in err


def test_python(camcal, place):
    """The blocks in their order, after the first calibration has written camera.yaml."""
    assert camcal("checkerboard", "sample_data/board", "-o", "camera.yaml")[0] == 0
    names = {}
    Path("points.csv").symlink_to(ROOT / "sample_data" / "rig.csv")
    for text in PYTHON:
        exec(compile(text, "README.md", "exec"), names)
    assert names["solution"].rms_point < 1
