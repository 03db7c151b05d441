"""`camcal uncertainty` as a user meets it."""

import json
from pathlib import Path

import pytest
import yaml

SAMPLES = Path(__file__).resolve().parents[2] / "sample_data"


def test_pixels_and_distances(camcal, report):
    code, out, err = camcal(
        "uncertainty", report, "--at", "320,240", "--at", "10,10", "--distance", "500", "--distance", "inf",
        "--format", "json",
    )  # fmt: skip
    assert (code, err) == (0, "")
    found = json.loads(out)
    assert [(p["u"], p["distance"]) for p in found["points"]] == [
        (320, 500), (10, 500), (320, float("inf")), (10, float("inf")),
    ]  # fmt: skip
    assert all(0 < p["sigma_px"] < 5 for p in found["points"])
    assert found["points"][1]["sigma_px"] > found["points"][0]["sigma_px"]
    assert found["unit"] == "mm"


def test_it_stands_in_the_report(camcal, report):
    held = yaml.safe_load(Path(report).read_text())["uncertainty"]
    found = json.loads(camcal("uncertainty", report, "--format", "json")[1])
    assert held["board_distance"] == pytest.approx(found["board_distance"])
    assert [m["worst"]["sigma_px"] for m in held["maps"]] == [
        pytest.approx(p["sigma_px"], rel=1e-4) for p in found["points"] if p["what"] == "worst"
    ]


def test_the_table(camcal, report):
    code, out, _ = camcal("uncertainty", report)
    assert code == 0
    assert "worst" in out and "distance, mm" in out and "inf" in out
    assert max(map(len, out.splitlines())) <= 80


def test_a_gate(camcal, report):
    code, _, err = camcal("uncertainty", report, "--max-px", "1e-6")
    assert code == 1 and "FAIL: the largest sigma" in err
    code, _, err = camcal("uncertainty", report, "--max-px", "1e6")
    assert code == 0 and "PASS" in err


@pytest.mark.parametrize(
    ("args", "code", "words"),
    [
        (["--at", "320"], 2, "two coordinates"),
        (["--at", "a,b"], 2, "two coordinates"),
        (["--distance", "-1"], 2, "is not a number above 0, or inf."),
        (["--distance", "nan"], 2, "is not a number above 0, or inf."),
        (["--at", "90000,90000"], 3, "no ray"),
    ],
)
def test_bad_input(camcal, report, args, code, words):
    found, out, err = camcal("uncertainty", report, *args)
    assert (found, out) == (code, "")
    assert err.startswith("Error: ") and words in err


def test_a_camera_that_was_only_evaluated_has_none(camcal, report):
    assert camcal("evaluate", report, SAMPLES / "board", "-o", "e.yaml")[0] == 0
    assert yaml.safe_load(Path("e.yaml").read_text())["uncertainty"] is None
    code, out, err = camcal("uncertainty", "e.yaml")
    assert (code, out) == (3, "") and "estimated" in err
