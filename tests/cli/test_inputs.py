"""Pictures given to `estimate` and tables given to `checkerboard` and `detect`: the right command is named."""

import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from camcal.cli.inputs import refuse_missing, refuse_pictures


@pytest.fixture
def inputs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pictures").mkdir()
    cv2.imwrite("pictures/a.png", np.zeros((8, 8), np.uint8))
    (tmp_path / "film.mp4").write_bytes(b"")
    (tmp_path / "all.zip").write_bytes(b"")
    (tmp_path / "points.csv").write_text("view,X,Y,Z,u,v\n")


@pytest.mark.parametrize("given", ["pictures", "pictures/a.png", "film.mp4", "all.zip"])
def test_estimate_names_checkerboard(camcal, inputs, given):
    code, _, err = camcal("estimate", given)
    assert code == 3 and f"Try: camcal checkerboard {given}" in err


@pytest.mark.parametrize("given", ["film.mp4#3", "all.tif#2"])
def test_estimate_names_checkerboard_for_frames(camcal, inputs, given):
    Path("all.tif").write_bytes(b"")
    code, _, err = camcal("estimate", given)
    assert code == 3 and f"Try: camcal checkerboard '{given}'" in err


@pytest.mark.parametrize("command", [("checkerboard",), ("detect", "-o", "x.csv")])
def test_checkerboard_names_estimate(camcal, inputs, command):
    code, _, err = camcal(*command, "points.csv")
    assert code == 3 and "Try: camcal estimate points.csv" in err


def test_other_files_are_left_to_the_reader(inputs):
    Path("points.unknown").write_text("")
    refuse_pictures(["points.csv", "points.unknown"])


@pytest.mark.parametrize(
    "words",
    [
        ("estimate", "absent.csv"),
        ("checkerboard", "absent/"),
        ("checkerboard", ".", "absent.png"),
        ("estimate", "absent.npz", "--robust", "auto"),
        ("report", "absent.yaml"),
    ],
)
def test_a_wrong_path_is_refused_before_anything_is_loaded(words, tmp_path):
    code = "import sys; from camcal.cli.boundary import run; print(run(sys.argv[1:]), 'numpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, cwd=tmp_path)
    assert done.stdout.split() == ["3", "False"]
    assert "absent" in done.stderr and len(done.stderr.splitlines()) <= 3


@pytest.mark.parametrize("name", ["film.mp4#3", "of_*.png", "frame_%04d.png", "pictures.zip/a.png"])
def test_names_that_are_more_than_a_path_are_left_to_who_reads_them(name, tmp_path):
    (tmp_path / "pictures.zip").write_bytes(b"")
    refuse_missing([tmp_path / name])


def test_options_of_films_say_where_there_is_no_film(camcal, inputs):
    ignored = "none of the inputs is a film: --every, --from and --to are ignored"
    for limits, said in (((), False), (("--every", "2"), True), (("--from", "1"), True)):
        _, _, err = camcal("detect", "pictures", "-o", "x.csv", *limits)
        assert (ignored in err) == said


def test_films_and_raw_pictures_beside_pictures_are_named(camcal, inputs):
    said = "not used, as there are pictures in the same folder: "
    assert said not in camcal("detect", "pictures", "-o", "x.csv")[2]
    for name in ("b.mp4", "c.dng", "._d.dng", "notes.txt"):
        Path("pictures", name).write_bytes(b"")
    assert said + "b.mp4, c.dng; name" in " ".join(camcal("detect", "pictures", "-o", "x.csv")[2].split())
