"""`camcal report` as a user meets it."""

from pathlib import Path

import pytest

from camcal.cli.boundary import run

SAMPLES = Path(__file__).resolve().parents[2] / "sample_data"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "r.yaml"
    assert run(["checkerboard", str(SAMPLES / "board"), "--no-crosscheck", "-q", "-o", str(path)]) == 0
    return path.read_text(encoding="utf-8")


@pytest.fixture
def report(made):
    Path("r.yaml").write_text(made, encoding="utf-8")
    return "r.yaml"


def test_a_page(camcal, report):
    code, out, err = camcal("report", report)
    assert (code, out) == (0, "") and "r.html" in err
    text = Path("r.html").read_text(encoding="utf-8")
    assert text.startswith("<!DOCTYPE html>")
    assert (
        text.count("data:image/jpeg;base64,") == 14
    )  # the pictures are still there, and one of them twice without distortion
    code, _, err = camcal("report", report)
    assert code == 2 and "--force" in err
    assert camcal("report", report, "--force")[0] == 0


def test_charts(camcal, report):
    code, _, err = camcal("report", report, "--plots", "plots", "--plot-format", "svg")
    assert code == 0 and "charts written" in err
    assert not Path("r.html").exists()
    assert {p.suffix for p in Path("plots").iterdir()} == {".svg"}
    assert Path("plots/residuals.svg").exists()


@pytest.mark.parametrize(
    ("args", "code", "words"),
    [
        (["absent.yaml"], 3, "absent.yaml"),
        ([SAMPLES / "rig.truth.yaml"], 3, "not a camcal report"),
        (["r.yaml", "-o", "nowhere/r.html"], 2, "nowhere"),
        (["r.yaml", "--plots", "p", "--plot-format", "gif"], 2, "gif"),
    ],
)
def test_bad_input(camcal, report, args, code, words):
    found, out, err = camcal("report", *args)
    assert (found, out) == (code, "")
    assert err.startswith("Error: ") and words in err
