"""`camcal compare-optimizers`, and --trace and --no-normalise of the calibrations."""

import csv
import json
from pathlib import Path

import pytest
import yaml

from camcal.data.observations import Correspondences
from camcal.data.writing import write_points
from camcal.solve.optimizers import OPTIMIZERS
from tests import solved
from tests.solve.problems import views_of

RIG = Path(__file__).resolve().parents[2] / "sample_data" / "rig.csv"


@pytest.fixture
def points():
    views, _ = views_of(solved.camera_of("opencv4", solved.TRUTH), count=4)
    write_points("points.csv", Correspondences.from_views(views))
    return "points.csv"


def read(path):
    with Path(path).open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_all_of_them(camcal, points):
    code, out, err = camcal(
        "compare-optimizers",
        points,
        "--model",
        "pinhole",
        "--perturbed",
        "1",
        "-o",
        "o.yaml",
        "--trace",
        "t.csv",
    )
    assert code == 0, err
    assert max(map(len, out.splitlines())) <= 80
    made = yaml.safe_load(Path("o.yaml").read_text(encoding="utf-8"))
    assert made["schema"] == "camcal-optimizers/1" and made["views"] == 4 and made["points"] == 216
    rows = {row["name"]: row for row in made["optimizers"]}
    assert set(rows) == set(OPTIMIZERS)
    lowest = min(row["cost"] for row in rows.values())
    assert rows["lm"]["converged"] and rows["dogleg"]["converged"]
    for row in rows.values():
        if row["converged"]:
            assert row["cost"] <= lowest * (1 + 1e-6)
        assert row["evaluations"] > 0 and row["seconds"] > 0 and row["info"]["variables"]
        assert row["perturbed"]["starts"] == 1 and row["curve"][-1][1] == row["cost"]
    assert made["best"]["cost"] >= lowest
    trace = read("t.csv")
    assert set(trace[0]) == {"name", "start", "iteration", "cost", "evaluations", "seconds"}
    assert {(row["name"], row["start"]) for row in trace} == {(n, s) for n in rows for s in "01"}


def test_some_of_them_as_json(camcal, points):
    code, out, _ = camcal(
        "compare-optimizers",
        points,
        "--optimizers",
        "lm:qr,lbfgs:scaled",
        "--perturbed",
        "0",
        "--format",
        "json",
    )
    assert code == 0
    made = json.loads(out)
    assert [row["name"] for row in made["optimizers"]] == ["lm:qr", "lbfgs:scaled"]
    assert made["optimizers"][0]["perturbed"] is None


@pytest.mark.parametrize("rotation", ["vector", "quaternion", "euler"])
def test_other_rotations(camcal, points, rotation):
    told = ["--optimizers", "lm:schur,dogleg:schur", "--perturbed", "0", "--format", "json"]
    code, out, err = camcal("compare-optimizers", points, "--rotation", rotation, *told)
    assert code == 0, err
    made = json.loads(out)
    assert made["rotation"] == rotation
    assert all(row["converged"] for row in made["optimizers"])


def test_refusals(camcal, points):
    code, _, err = camcal("compare-optimizers", points, "--optimizers", "lm,newton")
    assert code == 2 and "newton" in err
    code, _, err = camcal("compare-optimizers", points, "--rotation", "euler", "--optimizers", "scipy")
    assert code == 2 and "scipy" in err and "lm:schur" in err
    Path("o.yaml").write_text("")
    code, _, err = camcal("compare-optimizers", points, "-o", "o.yaml")
    assert code == 2 and "--force" in err


def test_the_plot(camcal, points):
    pytest.importorskip("matplotlib")
    told = ["--optimizers", "lm,lbfgs", "--perturbed", "0", "--plot", "c.svg"]
    code, _, err = camcal("compare-optimizers", points, *told)
    assert code == 0, err
    assert "<svg" in Path("c.svg").read_text(encoding="utf-8")


def test_trace_of_a_calibration(camcal):
    code, _, err = camcal("estimate", RIG, "--model", "opencv4", "--trace", "t.csv", "-o", "r.yaml")
    assert code == 0, err
    trace = read("t.csv")
    assert list(trace[0]) == ["iteration", "cost", "evaluations", "seconds"]
    costs = [float(row["cost"]) for row in trace]
    assert costs == sorted(costs, reverse=True) and trace[0]["iteration"] == "0"
    fit = yaml.safe_load(Path("r.yaml").read_text(encoding="utf-8"))["fit"]
    assert costs[-1] == fit["cost"]


def test_stages_say_what_normalisation_is_worth(camcal):
    both = {}
    for flag in ("--normalise", "--no-normalise"):
        code, out, err = camcal("estimate", RIG, "--model", "opencv4", flag, "--format", "json")
        assert code == 0, err
        both[flag] = json.loads(out)
    for flag, report in both.items():
        for stage in report["stages"]:
            found = stage["info"]["conditioning"]
            if flag == "--normalise":
                assert found["before"] > found["after"] >= 1
            else:
                assert found["before"] == found["after"]
    fx = [report["camera"]["parameters"]["fx"]["value"] for report in both.values()]
    # the same minimum; both stop where 1e-14 of the cost is left
    assert fx[0] == pytest.approx(fx[1], rel=1e-6)
