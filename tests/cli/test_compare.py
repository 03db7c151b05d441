"""`camcal compare` as a CI job meets it."""

import json
from pathlib import Path
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
import yaml

from camcal.report.ci import github, junit
from camcal.report.comparison import checks, pair

RIG = Path(__file__).resolve().parents[2] / "sample_data" / "rig.csv"


@pytest.fixture
def reports(camcal):
    for model in ("opencv4", "opencv5"):
        assert camcal("estimate", RIG, "--model", model, "--no-crosscheck", "-o", f"{model}.yaml")[0] == 0
    return "opencv4.yaml", "opencv5.yaml"


def test_gates_and_exit_codes(camcal, reports):
    a, b = reports
    assert camcal("compare", a, a, "--max-px", "1e-6")[0] == 0
    code, out, err = camcal(
        "compare", a, b, "--max-px", "1e-6", "--max-sigma", "100", "--tolerance", "fx=1e4", "--junit", "j.xml"
    )
    assert code == 1
    assert "FAILED: projection at infinity" in err and "ok: parameter fx" in err
    assert max(map(len, out.splitlines())) <= 80
    suite = ElementTree.parse("j.xml").getroot().find("testsuite")
    assert (suite.get("tests"), suite.get("failures")) == ("3", "1")
    assert len(suite.findall("testcase/failure")) == 1


def test_a_file_that_is_missing_is_a_failed_test_case(camcal, reports):
    code, _, err = camcal("compare", reports[0], "missing.yaml", "--max-px", "1", "--junit", "j.xml")
    assert code == 3 and "missing.yaml" in err
    suite = ElementTree.parse("j.xml").getroot().find("testsuite")
    assert (suite.get("tests"), suite.get("failures")) == ("1", "1")
    assert "missing.yaml" in suite.find("testcase/failure").get("message")


def test_documents(camcal, reports):
    code, out, _ = camcal(
        "compare", *reports, "--distance", "inf", "--distance", "400", "--format", "json", "-o", "c.yaml"
    )
    assert code == 0
    found = json.loads(out)
    assert [p["distance"] for p in found["projection"]] == [float("inf"), 400]
    assert all(p["max_px"] >= p["median_px"] > 0 for p in found["projection"])
    assert (
        yaml.safe_load(Path("c.yaml").read_text())["parameters"]["fx"]["change"]
        == found["parameters"]["fx"]["change"]
    )


def test_annotations(camcal, reports):
    code, _, err = camcal("compare", *reports, "--max-px", "1e-6", "--annotations", "github")
    assert code == 1
    line = next(line for line in err.splitlines() if line.startswith("::"))
    assert line.startswith("::error title=camcal compare,file=opencv5.yaml::projection at infinity: ")


def test_opencv_s_own_files(camcal, reports):
    report = yaml.safe_load(Path("opencv5.yaml").read_text())
    store = cv2.FileStorage("cv.yml", cv2.FILE_STORAGE_WRITE)
    store.write("camera_matrix", np.array(report["camera"]["matrix"]))
    bend = [report["camera"]["parameters"][k]["value"] for k in ("k1", "k2", "p1", "p2", "k3")]
    store.write("distortion_coefficients", np.array(bend))
    store.release()
    assert camcal("compare", "opencv5.yaml", "cv.yml", "--max-px", "1e-9", "--max-sigma", "1e-3")[0] == 0


def test_against_a_fresh_run_of_cv2(camcal, reports):
    # the two stop at the same minimum; cv2 sees the points rounded to float32
    assert camcal("compare", "opencv5.yaml", "--against", "cv2", "--max-sigma", "0.05")[0] == 0
    assert camcal("estimate", RIG, "--model", "kb4", "--no-crosscheck", "-o", "kb4.yaml")[0] == 0
    code, out, err = camcal("compare", "kb4.yaml", "--against", "cv2")
    assert (code, out) == (3, "") and "cv2" in err


@pytest.mark.parametrize(
    ("args", "code", "words"),
    [
        (["opencv4.yaml"], 2, "--against cv2"),
        (["opencv4.yaml", "opencv5.yaml", "--against", "cv2"], 2, "two cameras"),
        (["opencv4.yaml", "absent.yaml"], 3, "absent.yaml"),
        (["opencv4.yaml", RIG], 3, "rig.csv"),
        (["opencv4.yaml", "opencv5.yaml", "--tolerance", "fx"], 2, "fx=0.5"),
        (["opencv4.yaml", "opencv5.yaml", "--tolerance", "zz=1"], 3, "zz"),
        (["opencv4.yaml", "opencv5.yaml", "--junit", "opencv4.yaml"], 2, "--force"),
    ],
)
def test_bad_input(camcal, reports, args, code, words):
    found, out, err = camcal("compare", *args)
    assert (found, out) == (code, "")
    assert err.startswith("Error: ") and words in err


DOCUMENT = {
    "a": {"name": "a.yaml"},
    "b": {"name": "b.yaml"},
    "gates": [
        {"name": "projection at infinity", "value": 0.25, "bound": 0.1, "unit": "px", "passed": False},
        {"name": "parameter fx", "value": 0.5, "bound": 1.0, "unit": "", "passed": True},
    ],
}


def test_junit_to_the_letter():
    assert junit("camcal compare", pair(DOCUMENT), checks(DOCUMENT)) == (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<testsuites name="camcal compare" tests="2" failures="1" errors="0">\n'
        '  <testsuite name="a.yaml against b.yaml" tests="2" failures="1" errors="0" skipped="0">\n'
        '    <testcase classname="camcal.compare" name="projection at infinity (px)" time="0">\n'
        '      <failure type="tolerance" message="projection at infinity: 0.25 px exceeds 0.1 px">'
        "projection at infinity: 0.25 px exceeds 0.1 px\na.yaml against b.yaml</failure>\n"
        "    </testcase>\n"
        '    <testcase classname="camcal.compare" name="parameter fx" time="0" />\n'
        "  </testsuite>\n"
        "</testsuites>\n"
    )


def test_annotations_to_the_letter():
    assert github("camcal compare", checks(DOCUMENT)) == (
        "::error title=camcal compare::projection at infinity: 0.25 px exceeds 0.1 px\n"
        "::notice title=camcal compare::parameter fx: 0.5 is within 1\n"
    )
