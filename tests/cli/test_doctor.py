"""`camcal doctor` as a user meets it."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

SAMPLES = Path(__file__).resolve().parents[2] / "sample_data"


def test_of_a_report(camcal):
    assert camcal("checkerboard", SAMPLES / "board", "-o", "r.yaml", "--no-crosscheck")[0] == 0
    code, out, err = camcal("doctor", "r.yaml", "--format", "json")
    assert (code, err) == (0, "")
    found = json.loads(out)
    assert (found["schema"], found["about"], found["healthy"]) == ("camcal-doctor/1", "calibration", True)
    assert found["sentence"]
    times = [f["gain"]["times"] for f in found["findings"] if f["grade"] == "better" and f["gain"]]
    assert times == sorted(times, reverse=True)
    code, out, _ = camcal("doctor", "r.yaml")
    assert code == 0 and found["sentence"][:30] in out
    assert max(map(len, out.splitlines())) <= 80


def test_of_pictures(camcal):
    code, out, _ = camcal("doctor", SAMPLES / "board", "--format", "yaml")
    found = yaml.safe_load(out)
    assert code == 0 and found["about"] == "data" and found["rms_point"] < 1
    assert all("then camcal next" in f["todo"] for f in found["findings"] if f["code"] == "next-pictures")


def test_of_pictures_without_a_board(camcal):
    Path("pictures").mkdir()
    for i in range(2):
        cv2.imwrite(f"pictures/{i}.png", np.random.default_rng(i).integers(0, 255, (120, 160), np.uint8))
    code, out, _ = camcal("doctor", "pictures", "--format", "json")
    found = json.loads(out)
    assert code == 1 and not found["healthy"]
    assert found["findings"][0]["code"] == "no-target"


def test_of_boards_parallel_to_the_image(camcal):
    rng = np.random.default_rng(1)
    x, y = np.meshgrid(np.arange(9.0), np.arange(6.0))
    rows = ["view,X,Y,Z,u,v"]
    for i in range(8):
        scale, shift = rng.uniform(30, 50), rng.uniform(100, 200, 2)
        for a, b in zip(x.ravel(), y.ravel(), strict=True):
            u, v = scale * a + shift[0] + rng.normal(0, 0.1), scale * b + shift[1] + rng.normal(0, 0.1)
            rows.append(f"v{i},{a},{b},0,{u},{v}")
    Path("p.csv").write_text("\n".join(rows))
    code, out, _ = camcal("doctor", "p.csv", "--image-size", "640x480")
    assert code == 1 and "Tilt the target" in out


def test_of_the_installation(camcal):
    code, out, _ = camcal("doctor")
    assert code == 0 and "camcal works here" in out and "opencv" in out and "cache" in out
    found = json.loads(camcal("doctor", "--format", "json")[1])
    assert found["about"] == "installation" and found["checks"]


@pytest.mark.parametrize(
    ("args", "code", "words"),
    [
        (["absent.yaml"], 3, "absent.yaml"),
        (["nowhere"], 3, "nowhere"),
        ([SAMPLES / "rig.truth.yaml"], 3, "not a camcal report"),
        (["x.csv", "--model", "opencv55"], 2, "opencv5"),
    ],
)
def test_bad_input(camcal, args, code, words):
    found, out, err = camcal("doctor", *args)
    assert (found, out) == (code, "")
    assert err.startswith("Error: ") and words in err
