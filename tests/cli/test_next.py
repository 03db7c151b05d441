"""`camcal next` as a user meets it."""

import json
from pathlib import Path

import numpy as np
import pytest

SAMPLES = Path(__file__).resolve().parents[2] / "sample_data"


def test_suggestions_as_a_document(camcal, report):
    code, out, err = camcal("next", report, "--count", "2", "--target-px", "1e-9", "--format", "json")
    assert (code, err) == (0, "")
    found = json.loads(out)
    assert found["schema"] == "camcal-next/1"
    worst = [found["now"]["worst_px"], *(s["worst_px"] for s in found["suggestions"])]
    assert len(worst) == 3 and worst[0] > worst[1] > worst[2] > 0
    for suggestion in found["suggestions"]:
        outline = np.array(suggestion["outline"])
        assert (outline >= -0.5).all() and (outline < [639.5, 479.5]).all()
        assert "mm away" in suggestion["words"]
        assert len(suggestion["cam_from_board"]["rotation_vector"]) == 3
    assert found["target"] == {"worst_px": 1e-9, "more_pictures": None, "tried": 100}


def test_now_is_what_uncertainty_says(camcal, report):
    there = json.loads(camcal("uncertainty", report, "--distance", "inf", "--format", "json")[1])
    now = json.loads(camcal("next", report, "--format", "json")[1])["now"]
    worst = next(p["sigma_px"] for p in there["points"] if p["what"] == "worst")
    assert now["worst_px"] == pytest.approx(worst, rel=0.01)  # the corners are in both grids


def test_the_table(camcal, report):
    code, out, _ = camcal("next", report, "--target-px", "1000")
    assert code == 0
    assert "now" in out and "of the picture" in out and "0 more pictures for 1000 px" in out
    assert max(map(len, out.splitlines())) <= 80


def test_the_same_seed_says_the_same(camcal, report):
    said = [camcal("next", report, "--seed", seed, "--format", "json")[1] for seed in (5, 5, 6)]
    assert said[0] == said[1] != said[2]


def test_drawings(camcal, report):
    pytest.importorskip("matplotlib")
    code, _, err = camcal("next", report, "-o", "one.svg")
    assert code == 0, err
    drawn = Path("one.svg").read_text()
    assert "<svg" in drawn
    assert camcal("next", report, "-o", "n.png", "--count", "2")[0] == 0
    assert {p.name for p in Path().glob("n-*.png")} == {"n-1.png", "n-2.png"}
    code, _, err = camcal("next", report, "-o", "one.svg")
    assert code == 2 and "--force" in err
    assert camcal("next", report, "-o", "one.svg", "--force")[0] == 0
    assert Path("one.svg").read_text() == drawn


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["-o", "n.gif"], ".svg, .png, .pdf"),
        (["--count", "0"], "0"),
        (["--target-px", "0"], "0"),
        (["--distance", "-1"], "is not a number above 0, or inf."),
    ],
)
def test_bad_usage(camcal, report, args, words):
    code, out, err = camcal("next", report, *args)
    assert (code, out) == (2, "")
    assert err.startswith("Error: ") and words in err


def test_a_camera_that_was_only_evaluated(camcal, report):
    assert camcal("evaluate", report, SAMPLES / "board", "-o", "e.yaml")[0] == 0
    code, out, err = camcal("next", "e.yaml")
    assert (code, out) == (3, "") and "estimated" in err
