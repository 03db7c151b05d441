"""The main jobs as a user meets them: exit code, report, stdout and stderr."""

import json
from pathlib import Path

import pytest
import yaml

SAMPLES = Path(__file__).resolve().parents[2] / "sample_data"
RIG, BOARD = SAMPLES / "rig.csv", SAMPLES / "board"


def report(path="report.yaml"):
    return yaml.safe_load(Path(path).read_text(encoding="utf-8"))


def test_estimate_writes_its_report(camcal):
    code, out, err = camcal("estimate", RIG, "--model", "opencv4", "-o", "report.yaml")
    assert code == 0
    assert "rms_point" in out
    assert max(map(len, out.splitlines())) <= 80
    assert "PASS" in err
    assert "Report written to report.yaml." in err
    made = report()
    assert made["schema"] == "camcal-report/1"
    assert made["command"] == ["estimate", str(RIG), "--model", "opencv4", "-o", "report.yaml"]
    assert made["options"]["model"] == {"value": "opencv4", "from": "flag"}
    assert made["options"]["seed"] == {"value": 0, "from": "default"}
    assert made["verdict"] == "pass"


def test_a_gate_that_fell_still_leaves_its_report(camcal):
    code, _, err = camcal("estimate", RIG, "--max-rms", "0.001", "-o", "report.yaml")
    assert code == 1
    assert "--max-rms 0.001" in err
    assert report()["verdict"] == "fail"


@pytest.mark.parametrize(("format", "read"), [("json", json.loads), ("yaml", yaml.safe_load)])
def test_stdout_is_one_document(camcal, format, read):
    code, out, _ = camcal("estimate", RIG, "--format", format)
    assert code == 0
    assert read(out)["fit"]["rms_point"] > 0


def test_quiet(camcal):
    code, out, err = camcal("estimate", RIG, "-q", "-o", "report.yaml")
    assert (code, err) == (0, "")
    assert out


def test_an_output_that_exists(camcal):
    Path("report.yaml").write_text("mine")
    code, out, err = camcal("estimate", RIG, "-o", "report.yaml")
    assert (code, out) == (2, "")
    assert "--force" in err
    assert Path("report.yaml").read_text() == "mine"
    assert camcal("estimate", RIG, "-o", "report.yaml", "--force")[0] == 0
    assert report()["verdict"] == "pass"


@pytest.mark.parametrize("output", ["absent/report.yaml", "."])
def test_an_output_that_cannot_be(camcal, output):
    code, out, err = camcal("estimate", RIG, "-o", output)
    assert (code, out) == (2, "")
    assert err.startswith("Error: cannot write")


@pytest.mark.parametrize(
    ("args", "code", "words"),
    [
        (["estimate", "absent.csv"], 3, "absent.csv"),
        (["estimate"], 2, "--points3d"),
        (["estimate", "--points3d", RIG], 2, "--points2d"),
        (["estimate", RIG, "--fix", "k9"], 2, "k9"),
        (["estimate", "empty.csv"], 3, "empty.csv"),
        (["checkerboard", "absent"], 3, "absent"),
        (["checkerboard", "folder"], 3, "no pictures"),
        (["checkerboard"], 2, "IMAGES"),
        (["checkerboard", BOARD, "--target", "checkerboard:9x6:25mm", "--board", "9x6"], 2, "board"),
        (["evaluate", "absent.yaml", RIG], 3, "absent.yaml"),
        (["evaluate", RIG, RIG], 3, "rig.csv"),
    ],
)
def test_bad_input(camcal, args, code, words):
    Path("empty.csv").write_text("")
    Path("folder").mkdir()
    found, out, err = camcal(*args, "-o", "report.yaml")
    assert (found, out) == (code, "")
    assert err.startswith("Error: ")
    assert words in err
    assert not Path("report.yaml").exists()


def test_evaluate_keeps_the_camera(camcal):
    # the corners of the first pass, which are those that `evaluate` finds
    assert camcal("checkerboard", BOARD, "--no-refine-corners", "-o", "camera.yaml")[0] == 0
    code, _, err = camcal("evaluate", "camera.yaml", BOARD, "-o", "again.yaml")
    assert code == 0, err
    first, again = report("camera.yaml"), report("again.yaml")
    assert again["camera"]["matrix"] == first["camera"]["matrix"]
    assert all(entry["fixed"] for entry in again["camera"]["parameters"].values())
    # the same points, but weighted by their own sigmas alone, not by the calibration's noise model: .07 % here
    assert again["fit"]["rms_point"] == pytest.approx(first["fit"]["rms_point"], rel=5e-3)


def test_pictures_without_noise_on_stdout(camcal):
    code, out, err = camcal("checkerboard", BOARD, "--format", "json")
    assert code == 0
    found = json.loads(out)
    assert (found["target"]["columns"], found["target"]["rows"], found["target"]["unit"]) == (9, 6, "square")
    assert "9x6" in err
