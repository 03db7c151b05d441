"""`camcal rig` through its entry point."""

from pathlib import Path

import numpy as np
import pytest
import yaml

import camcal as public
from tests.rigs import LENS, observed, truth, write_table


@pytest.fixture
def table():
    """Two cameras, ten instants."""
    return write_table("points.csv", observed(truth("ab"))[0])


def test_a_table_gives_a_rig(camcal, table):
    code, out, err = camcal("rig", table, "--image-size", "640x480", "-m", LENS, "-o", "rig.yaml")
    assert code == 0, err
    assert "a-b" in out and "PASS" in err
    made = yaml.safe_load(Path("rig.yaml").read_text())
    assert made["schema"] == "camcal-report/1" and "camera" not in made
    assert list(made["cameras"]) == ["a", "b"] and made["rig"]["reference"] == "a"
    assert {v["camera"] for v in made["views"]} == {"a", "b"}
    baseline = made["rig"]["baselines"]["a-b"]
    known = truth("ab").baseline("a", "b")
    assert abs(baseline["value"] - known) < 4 * baseline["sigma"] < 0.02 * known


def test_the_report_reads_back_as_a_rig(camcal, table):
    camcal("rig", table, "--image-size", "640x480", "-m", LENS, "-o", "rig.yaml", "--reference", "b")
    rig = public.load("rig.yaml")
    assert isinstance(rig, public.Rig) and rig.reference == "b"
    made = yaml.safe_load(Path("rig.yaml").read_text())["rig"]["cam_from_rig"]["a"]
    np.testing.assert_allclose(rig.cam_from_rig["a"].translation, made["translation"])


def test_words_that_are_no_rig(camcal, table):
    code, _, err = camcal("rig", "left", "right")
    assert code == 2 and "NAME=FOLDER" in err
    code, _, err = camcal("rig", table, "--hold", "c")
    assert code == 2 and "'c'" in err
