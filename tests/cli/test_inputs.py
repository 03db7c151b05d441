"""Pictures given to `estimate` and tables given to `checkerboard` and `detect`: the right command is named."""

import cv2
import numpy as np
import pytest

from camcal.cli.inputs import refuse_pictures


@pytest.fixture
def inputs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pictures").mkdir()
    cv2.imwrite("pictures/a.png", np.zeros((8, 8), np.uint8))
    (tmp_path / "film.mp4").write_bytes(b"")
    (tmp_path / "points.csv").write_text("view,X,Y,Z,u,v\n")


@pytest.mark.parametrize("given", ["pictures", "pictures/a.png", "film.mp4"])
def test_estimate_names_checkerboard(camcal, inputs, given):
    code, _, err = camcal("estimate", given)
    assert code == 3 and f"Try: camcal checkerboard {given}" in err


@pytest.mark.parametrize("command", [("checkerboard",), ("detect", "-o", "x.csv")])
def test_checkerboard_names_estimate(camcal, inputs, command):
    code, _, err = camcal(*command, "points.csv")
    assert code == 3 and "Try: camcal estimate points.csv" in err


def test_other_files_are_left_to_the_reader(inputs):
    refuse_pictures(["points.csv", "points.unknown", "nothing/there"])
