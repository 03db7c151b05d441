"""Which model contains which: the whole relation, and its embeddings on random cameras."""

from pathlib import Path

import numpy as np
import pytest

from camcal.model import lenses
from camcal.model.lenses.containment import contained, contains, embed
from tests.contracts import lens_battery as battery
from tests.contracts.lens_specs import SPECS

MORE = (
    "brown:radial=3,decentering=2", "brown:radial=3,decentering=1,prism=1", "kb:1", "scaramuzza:2", "division:2",
    "spline:7x5", "radial-profile:8,centre=free", "radial-profile:12",
)  # fmt: skip
TABLE = {lens.name: lens for lens in map(lenses.make, (*SPECS, *MORE))}
#: cameras without distortion under other names
PLAIN = {"pinhole", "brown:radial=0,decentering=0", "division:0"}
#: models that hold every perspective camera
PERSPECTIVE = {n for n, m in TABLE.items() if m.neutral_curve == "perspective" and not m.shaped_by_data}
B20, B31, B41 = (
    "brown:radial=2,decentering=0",
    "brown:radial=3,decentering=1",
    "brown:radial=4,decentering=3,prism=1",
)
B32, B31S = "brown:radial=3,decentering=2", "brown:radial=3,decentering=1,prism=1"
B32SF, B20F = "brown:radial=3,decentering=2,prism=1,centre=free", "brown:radial=2,decentering=0,centre=free"
D1, D3 = "division:1,direction=distort", "division:3,direction=distort"
#: outer -> inner, from the equations in docs/lenses.md, without the plain cameras and the model itself
PAIRS = {
    "opencv4": {B20},
    "opencv5": {"opencv4", B20, B31},
    "opencv8": {"opencv4", "opencv5", B20, B31, D1, D3},
    "opencv12": {"opencv4", "opencv5", "opencv8", B20, B31, B31S, D1, D3},
    "opencv14": {"opencv4", "opencv5", "opencv8", "opencv12", B20, B31, B31S, D1, D3},
    B31: {"opencv4", "opencv5", B20},
    B41: {"opencv4", "opencv5", B20, B31, B32, B31S},
    B32: {"opencv4", "opencv5", B20, B31},
    B31S: {"opencv4", "opencv5", B20, B31},
    B20F: {B20},
    B32SF: {"opencv4", "opencv5", B20, B31, B32, B31S, B20F},
    "kb:1": {"kb:0"},
    "kb:2": {"kb:0", "kb:1"},
    "kb4": {"kb:0", "kb:1", "kb:2", "kb:4"},
    "kb:4": {"kb:0", "kb:1", "kb:2", "kb4"},
    "kb:6": {"kb:0", "kb:1", "kb:2", "kb:4", "kb4"},
    "eucm": {"ucm"},
    "ds": {"ucm"},
    "mei": {"ucm", "opencv4", B20},
    "fov": {"kb:0"},
    "division:1": {"scaramuzza:2"},
    "scaramuzza:2": {"division:1"},
    "division:2": {"division:1", "scaramuzza:2"},
    "division:3": {"division:1", "division:2", "scaramuzza:2"},
    D3: {D1},
    "scaramuzza": {"division:1", "division:2", "scaramuzza:2"},
    "scaramuzza:6": {"division:1", "division:2", "division:3", "scaramuzza:2", "scaramuzza"},
    "rational-function": {"division:1", "scaramuzza:2", "polynomial:2"},
    "bicubic": {"polynomial:2", "polynomial:3"},
    "polynomial:3": {"polynomial:2", "bicubic"},
    "polynomial:5": {"polynomial:2", "polynomial:3", "bicubic"},
    "radial-profile": {"radial-profile:4"},
    "radial-profile:12": {"radial-profile:4"},
    "radial-profile:8,centre=free": {"radial-profile:4", "radial-profile"},
    "spline:5x4": {"spline:4x4,smooth=0.1"},
    "spline:7x5": {"spline:5x4", "spline:4x4,smooth=0.1"},
}


@pytest.mark.parametrize("outer", TABLE)
def test_the_relation(outer):
    found = {inner for inner in TABLE if battery.check_embedding(TABLE[outer], TABLE[inner])}
    assert found == {outer} | PAIRS.get(outer, set()) | (PLAIN if outer in PERSPECTIVE else set())


@pytest.mark.parametrize("outer", ["opencv8", "mei", "rational-function", "radial-profile"])
def test_skew(outer):
    """A model with skew contains those without; not the other way round, unless the skew is 0."""
    plain, skewed = lenses.make(outer), lenses.make(outer, skew=True)
    assert battery.check_embedding(skewed, plain) and not contains(plain, skewed)
    params = skewed.examples()[0][0]
    assert embed(plain, skewed, params) is None
    if not plain.shaped_by_data:
        params[4] = 0.0
        assert embed(plain, skewed, params).tolist() == np.delete(params, 4).tolist()


def test_single_cameras():
    """Models that share some cameras only: barrel-shaped division, which is eucm with α = 1/2; decentering of 0."""
    division, eucm = lenses.make("division:1"), lenses.make("eucm")
    params, size = division.examples()[0]
    xyz = battery.directions(division, params, size)
    error = eucm.project(embed(eucm, division, params), xyz)[0] - division.project(params, xyz)[0]
    assert np.abs(error).max() < battery.ROUND_TRIP
    params[4] *= -1
    assert embed(eucm, division, params) is None and not contains(eucm, division)
    opencv5, radial = lenses.make("opencv5"), lenses.make("brown:radial=3,decentering=0")
    params = opencv5.examples()[0][0]
    assert embed(radial, opencv5, params) is None
    params[6:8] = 0.0
    assert embed(radial, opencv5, params).tolist() == params[[0, 1, 2, 3, 4, 5, 8]].tolist()


def test_alpha_of_one_is_the_limit_of_mei():
    ucm, mei = lenses.make("ucm"), lenses.make("mei")
    params = ucm.from_values({"fx": 300.0, "fy": 300.0, "cx": 320.0, "cy": 240.0, "alpha": 1.0})
    angle = np.linspace(0, 1.4, 20)
    xyz = np.stack([np.sin(angle), 0 * angle, np.cos(angle)], 1)
    error = mei.project(embed(mei, ucm, params), xyz)[0] - ucm.project(params, xyz)[0]
    assert np.abs(error).max() < 1e-9 * 300 * np.tan(1.4) + 1e-9  # see HIGHEST_ALPHA


@pytest.mark.parametrize(
    "spec, wanted",
    [
        ("opencv5", ("opencv4", "pinhole")),
        ("opencv8", ("opencv5", "opencv4", "pinhole")),
        ("mei", ("ucm", "opencv4", "pinhole")),
        ("kb:6", ("kb:5", "kb4", "kb:3", "kb:2", "kb:1", "kb:0")),
        ("brown:radial=3,decentering=2", (B31, "brown:radial=2,decentering=2", "opencv4", "pinhole")),
        ("rational-function", ("division:1", "pinhole")),
        ("spline:7x5", ("spline:7x4", "spline:5x5", "spline:4x5", "spline:5x4", "spline:4x4")),
        ("pinhole", ()),
    ],
)
def test_smaller_models_the_closest_first(spec, wanted):
    assert contained(lenses.make(spec)) == wanted


def table_of_the_docs():
    """The rows of the table in docs/lenses.md, as they have to be."""
    specs = dict.fromkeys(
        lenses.make(n).name for n in (*lenses.LENSES, "kb:0", "division:1,direction=distort")
    )
    rows = []
    for outer in specs:
        inner = [
            n for n in specs if n not in (outer, "pinhole") and contains(lenses.make(outer), lenses.make(n))
        ]
        if inner:
            rows.append(f"| {outer} | {', '.join(inner)} |")
    return rows


def test_the_table_in_the_docs():
    page = (Path(__file__).resolve().parents[2] / "docs" / "lenses.md").read_text(encoding="utf-8")
    table = page.split("<!-- containment -->")[1].split("<!-- /containment -->")[0].strip().splitlines()
    assert table[2:] == table_of_the_docs()
