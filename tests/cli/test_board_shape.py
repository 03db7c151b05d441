"""The board's shape on the command line: found, said in words, drawn, and used for the next calibration."""

from dataclasses import replace

import numpy as np
import pytest
import yaml

from camcal.data.writing import write_points
from tests.solved import camera_of, grid, observe, tilted_poses

BOARD = grid(7, 5)
CAMERA = camera_of("opencv4")
#: 2 % longer in y than in x and bent by .05
TRUE = BOARD * [1, 1.02, 1] + np.c_[np.zeros((35, 2)), 0.05 * (1 - (BOARD[:, 0] / 3 - 1) ** 2)]


@pytest.fixture
def estimate(camcal, tmp_path):
    """Run `camcal estimate` on views of the true board, said to be the ideal one."""

    def run(name, shape, seed=1, board=BOARD, code=0, target=None):
        rng = np.random.default_rng(seed)
        data = observe(CAMERA, tilted_poses(BOARD, 8, rng, shift=0.5), TRUE, 0.05, rng)
        path, report = tmp_path / f"{name}.csv", tmp_path / f"{name}.yaml"
        data = data.with_views(tuple(replace(v, xyz=board) for v in data.views))
        write_points(path, replace(data, target=target))
        args = ["--model", "opencv4", "--image-size", "640x480", "-o", report]
        args += ["--board-shape", shape] if shape else []
        found, out, err = camcal("estimate", path, *args)
        assert found == code, err
        return (yaml.safe_load(report.read_text()) if report.exists() else None), report, out + err

    return run


def error(report):
    values = {k: p["value"] for k, p in report["camera"]["parameters"].items()}
    return max(abs(values[k] - CAMERA.values[k]) for k in ("fx", "fy"))


@pytest.mark.parametrize("kind", ["print", "auto", "free"])
def test_the_print_is_measured_and_said(estimate, kind):
    report, _, screen = estimate("a", kind)
    shape = report["target"]["shape"]
    # over a dozen seeds they scatter by .0004 and .006 degrees; three times that
    assert shape["aspect"] == pytest.approx(1.02, abs=0.0013)
    assert shape["angle"] == pytest.approx(90, abs=0.02)
    assert f"{100 * (shape['aspect'] - 1):.2g} % longer in y than in x" in shape["words"]
    assert "the board bends by" in screen
    assert len(shape["points"]) == len(BOARD)
    flat, _, _ = estimate("flat", "flat")
    assert error(report) < 0.3 * error(flat)


def test_auto_says_what_it_tried(estimate):
    report, _, screen = estimate("a", "auto")
    shape = report["target"]["shape"]
    assert shape["kind"] == "print"
    assert [t["kind"] for t in shape["tried"]] == ["flat", "bowl", "print", "free"]
    assert "hold-out" in screen


def test_a_table_of_a_printed_target_is_calibrated_with_its_own_shape(estimate):
    target = {"kind": "checkerboard"}
    assert estimate("said", None, target=target)[0]["target"]["shape"]["kind"] != "flat"
    given, _, said = estimate("unsaid", None)
    assert given["target"] is None and "board-not-flat" in [w["code"] for w in given["warnings"]], said
    forced = estimate("forced", "flat", target=target)[0]
    assert "bowl" not in [s["name"] for s in forced["stages"]]


def test_a_known_shape_serves_the_next_calibration(estimate):
    _, known, _ = estimate("first", "free")
    flat, _, _ = estimate("flat", "flat", seed=2)
    again, _, screen = estimate("second", known, seed=2)
    shape = again["target"]["shape"]
    assert (shape["kind"], shape["from"]) == ("known", str(known))
    # noise alone leaves .05 √2 px, and the board was not known exactly
    assert again["fit"]["rms_point"] < 0.08 < 0.4 * flat["fit"]["rms_point"]
    assert error(again) < 0.3 * error(flat)
    assert "board: known" in screen
    # nothing of the board is estimated
    assert again["fit"]["free_parameters"] == flat["fit"]["free_parameters"]


def test_a_report_without_a_shape(estimate):
    _, flat, _ = estimate("flat", "flat")
    _, _, said = estimate("second", flat, code=3)
    assert "has no board shape" in said
    assert "--board-shape free" in said


def test_the_shape_of_another_board(estimate):
    _, known, _ = estimate("first", "bowl")
    _, _, said = estimate("second", known, board=BOARD * [1.5, 1, 1], code=3)
    assert "another board" in said


def test_the_shape_is_drawn(estimate, camcal, tmp_path):
    _, known, _ = estimate("first", "bowl")
    assert camcal("report", known, "--plots", tmp_path / "plots", "--plot-format", "svg")[0] == 0
    assert "Shape of the board" in (tmp_path / "plots" / "board-shape.svg").read_text()
    assert camcal("report", known, "-o", tmp_path / "page.html")[0] == 0
    assert "the board bends by" in (tmp_path / "page.html").read_text()
