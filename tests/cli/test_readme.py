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


def cells(page):
    """The rows of the tables of a page, as lists of words without blanks around them."""
    lines = (ROOT / page).read_text(encoding="utf-8").splitlines()
    return [[cell.strip() for cell in line[1:-1].split("|")] for line in lines if line.startswith("| ")]


def test_measured_figures_are_those_of_their_page():
    """Figures that the README repeats are those that the benchmarks wrote into docs/figures.md."""
    readme = {row[0]: row[1:3] for row in cells("README.md")}
    figures = {}
    for row in cells("docs/figures.md"):
        two = row[0] == "opencv5" and " x " in row[1]  # the table of refinements: model, size, camcal, cv2
        figures.setdefault(" ".join(row[:2]) if two else row[0], row[2:4] if two else row[1:3])
    for what, source in {
        "closed form and refinement, 10 views of 54 points, ms": "opencv5 10 x 54",
        "the same, 200 views of 54 points, ms": "opencv5 200 x 54",
        "all checks, hold-out and uncertainty, 200 views of 54 points, ms": "calibrate with checks, 200 x 54",
        "the command `checkerboard`, 13 pictures of 640x480, s": "checkerboard, 13 pictures 640x480, cold",
    }.items():
        assert [c.split()[0] for c in readme[what]] == [c.split()[0] for c in figures[source]], what


def test_each_claim_has_a_command_and_a_page():
    """The table beside other programs: a command, and a section or a page that names one of the row's commands."""
    claims = [
        row for row in cells("README.md") if len(row) == 4 and row[0] != "what" and "`camcal " in row[1]
    ]
    assert len(claims) >= 14
    for what, command, _, page in claims:
        target, _, anchor = re.search(r"\]\(([^)]+)\)", page)[1].partition("#")
        content = (ROOT / target).read_text(encoding="utf-8")
        heads = [
            re.sub(r"[^\w -]", "", h).lower().replace(" ", "-")
            for h in re.findall(r"^#+ (.+)", content, re.M)
        ]
        assert anchor in ("", *heads), (what, anchor)
        assert any(named in content for named in re.findall(r"camcal [a-z-]+|--[a-z-]+", command)), what


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
