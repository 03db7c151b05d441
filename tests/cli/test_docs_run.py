"""The code of the pages in docs/ runs as it stands, on small data (tutorials and recipes have tests of their own).

`PREPARED` makes the files that a page names; `ELSEWHERE` says which test runs the rest, or why nothing does.
"""

import re
import runpy
import shlex
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
SHORT = "-m pinhole --image-size 640x480 --no-crosscheck --holdout 0"
BOARD = "checkerboard board --square 25mm -m opencv4 --no-crosscheck --holdout 0 -o"

#: page -> what makes its files: commands, programs of examples/, and `FROM -> TO`, copies
PREPARED = {
    "trust.md": (
        f"{BOARD} report.yaml",
        "report.yaml -> old.yaml",
        "report.yaml -> new.yaml",
        "convert report.yaml camera.yml",
    ),
    "hand-eye.md": (
        "hand_eye_data.py robot",
        f"estimate robot/points.csv {SHORT} -o views.yaml",
        "robot/poses.csv -> poses.csv",
    ),
    "stereo.md": ("stereo_data.py stereo", f"rig stereo/boards.csv {SHORT} -o rig.yaml"),
    "report.md": (f"estimate sample_data/rig.csv {SHORT} -o report.yaml",),
    "input-formats.md": (
        "sample_data/rig.csv -> points.csv",
        "points.csv -> world.txt",
        "points.csv -> pixels.txt",
    ),
    "targets.md": (),
}

#: command, or the start of one -> where it is run, or why it is not
ELSEWHERE = {
    "checkerboard pictures/ --square 25mm -o views.yaml": "tests/cli/test_hand_eye.py, from pictures",
    "batch jobs/ -o out": "a table of points has no picture size here; tests/cli/test_batch.py, from pictures",
    "batch jobs.yaml": "tests/cli/test_batch.py, with a file of jobs",
    "checkerboard calibration/pictures": "docs/tutorials/ci-gate.md",
    "compare calibration/reference.yaml": "the same",
    "doctor": "tests/cli/test_doctor.py: a report, pictures, the installation",
    "next report.yaml -o": "docs/tutorials/good-pictures.md",
    "next report.yaml --count 5": "tests/cli/test_next.py",
    "next report.yaml --target-px": "the same",
    "report report.yaml": "docs/tutorials/first-calibration.md, tests/cli/test_report.py",
    "watch pictures/ -o camera.yaml --once": "tests/cli/test_watch.py",
    "watch pictures/ -o camera.yaml --target-px": "runs until pictures have arrived: tests/cli/test_watch.py",
    "watch pictures/ -o camera.yaml --serve": "runs until it is interrupted: tests/cli/test_watch.py",
    "checkerboard movie.mp4": "tests/detect/test_films.py, films that the test makes",
    "checkerboard a.mov": "the same",
    'checkerboard "frame_': "the same",
    "detect movie.mp4": "the same",
    "simulate images --target charuco": "20 rendered pictures take 10 s; tests/study/test_simulate.py, fewer",
    "rig left=imgs/left": "docs/tutorials/stereo.md and tests/cli/test_rig.py",
    "rig points.csv": "the same",
    "track ": "tests/cli/test_track.py, tests/track/test_rig_drift.py: frames, a rig, natural pictures",
    "simulate frames --kind knock -o frames.csv": "docs/tutorials/film.md",
}
#: pages whose Python another test runs; the reference has the forms of commands, not commands
PYTHON_ELSEWHERE = {"batch.md", "configuration.md", "rigs.md", "lenses.md"}
NO_COMMANDS = {"cli.md"}
TUTORIALS = {"how-to.md"}  #: run by tests/cli/test_tutorials.py

PAGES = sorted(p for p in (ROOT / "docs").glob("*.md") if p.name not in NO_COMMANDS | TUTORIALS)


def blocks(page, kinds):
    every = re.findall(r"^```(\w*)\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    return [text for kind, text in every if kind in kinds]


def commands(page):
    """The commands of a page, without `camcal` and comments."""
    lines = [line for block in blocks(page, ("", "sh")) for line in block.splitlines()]
    return [line.partition(" #")[0].strip()[7:] for line in lines if line.startswith("camcal ")]


def elsewhere(command):
    return any(command.startswith(start) for start in ELSEWHERE)


@pytest.fixture
def prepare(camcal, monkeypatch):
    """Make the files of a page in the current folder."""

    def make(step):
        """Of a table of points, `world.txt` gets X, Y, Z and `pixels.txt` u, v."""
        source, _, target = step.partition(" -> ")
        if target in ("world.txt", "pixels.txt"):
            values = np.genfromtxt(source, delimiter=",", skip_header=1)
            np.savetxt(target, values[:, 1:4] if target == "world.txt" else values[:, 4:6])
        elif target:
            Path(target).parent.mkdir(parents=True, exist_ok=True)
            (shutil.copytree if Path(source).is_dir() else shutil.copy)(source, target)
        elif source.split()[0].endswith(".py"):
            name, *args = source.split()
            monkeypatch.setattr(sys, "argv", [name, *args])
            runpy.run_path(str(ROOT / "examples" / name), run_name="__main__")
        else:
            code, _, err = camcal(*shlex.split(source))
            assert code == 0, f"{source}\n{err}"

    def all_of(page):
        Path("sample_data").symlink_to(ROOT / "sample_data")
        Path("board").symlink_to(ROOT / "sample_data" / "board")
        for step in PREPARED[page.name]:
            make(step)

    return all_of


@pytest.mark.parametrize("page", [p for p in PAGES if p.name in PREPARED], ids=lambda page: page.stem)
def test_page(camcal, prepare, page):
    prepare(page)
    for command in commands(page):
        if not elsewhere(command):
            code, _, err = camcal(*shlex.split(command))
            assert code == 0, f"{command}\n{err}"
    names = {"left_pixels": np.full((1, 2), 200.0), "right_pixels": np.full((1, 2), 190.0)}
    Path("hand.yaml").unlink(missing_ok=True)  # the Python of hand-eye.md writes it again
    for text in blocks(page, ("python",)):
        exec(compile(text, page.name, "exec"), names)


def test_the_error_on_the_page_of_configuration(camcal):
    """The message that the page quotes is the one that camcal prints."""
    (quoted,) = [b for b in blocks(ROOT / "docs" / "configuration.md", ("",)) if b.startswith("Error: ")]
    Path("camcal.yaml").write_text("modle: opencv5\n", encoding="utf-8")
    code, _, err = camcal("estimate", "points.csv")
    assert code == 2 and err == quoted


def test_quoted_messages_are_in_the_source():
    """Lines of output that pages show, without their figures and names, are made of the words of messages."""
    source = " ".join(p.read_text(encoding="utf-8") for p in (ROOT / "camcal").rglob("*.py"))
    quoted = {
        "batch.md": ("; worst uncertainty ", " px at the ", "  next: "),
        "targets.md": (". To select it: --target ",),
        "tracking.md": ("camera ", " deg about ", "focal length changed by ", " % at frame "),
    }
    for name, parts in quoted.items():
        shown = "\n".join(blocks(ROOT / "docs" / name, ("", "text")))
        for part in parts:
            assert part in shown and part in source, (name, part)


def test_nothing_is_left_out():
    """Every command of every page is run here, or has its reason; so has every page with Python."""
    reasonless = [c for p in PAGES if p.name not in PREPARED for c in commands(p) if not elsewhere(c)]
    assert reasonless == []
    assert {p.name for p in PAGES if blocks(p, ("python",))} <= PREPARED.keys() | PYTHON_ELSEWHERE
    every = [c for p in PAGES for c in commands(p)]
    assert [start for start in ELSEWHERE if not any(c.startswith(start) for c in every)] == []
