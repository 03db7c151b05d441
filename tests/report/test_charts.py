"""Charts as data, as SVG and as files."""

import sys
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from camcal.assess.fold_difference import difference_of_folds
from camcal.assess.holdout import described, hold_out
from camcal.errors import UsageError
from camcal.report.charts import CHARTS, charts
from camcal.report.charts.base import Bars, Cells, Chart, Line, Points, tick_text, ticks
from camcal.report.charts.colours import css_colour
from camcal.report.charts.files import drawn, write_charts
from camcal.report.charts.residuals import cell_means, enlargement, thinned
from camcal.report.charts.svg import svg
from camcal.solve.refine import How
from tests.solved import solved

NAMES = [n for n in CHARTS if n != "board-shape"]


@pytest.fixture(scope="module")
def solution():
    made = solved(views=12)
    held = hold_out(made, How())
    return replace(made, holdout=described(held, difference_of_folds(made, held)))


@pytest.fixture(scope="module")
def made(solution):
    return charts(solution)


def test_all_charts_of_an_ordinary_calibration(made):
    assert list(made) == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_svg_is_sound(made, name):
    root = ElementTree.fromstring(svg(made[name], name))
    width, height = map(float, root.get("viewBox").split()[2:])
    assert 200 < height < 800
    texts = [t for t in root.iter() if t.tag.endswith("}text")]
    assert len(texts) >= 4
    assert all(0 <= float(t.get("x", 0)) <= width for t in texts)
    assert "nan" not in svg(made[name], name).lower().replace("nanmean", "")


def test_a_chart_says_what_is_in_it(made):
    for chart in made.values():
        assert chart.text.endswith(".") and len(chart.text) > 40
        assert chart.x[0] < chart.x[1] and chart.y[0] < chart.y[1]


def test_files(tmp_path, solution, made, monkeypatch):
    few = {n: made[n] for n in ("views", "uncertainty-board")}  # drawing all of them takes seconds
    monkeypatch.setattr("camcal.report.charts.files.charts", lambda solution: few)
    formats = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}
    written = write_charts(solution, tmp_path / "plots", list(formats))
    assert [p.name for p in written] == [f"{n}.{f}" for n in few for f in formats]
    assert all(p.read_bytes().startswith(formats[p.suffix[1:]]) for p in written)
    with pytest.raises(UsageError, match="exists"):
        write_charts(solution, tmp_path / "plots", ["png"])
    before = [p.read_bytes() for p in written]
    write_charts(solution, tmp_path / "plots", list(formats), force=True)
    assert [p.read_bytes() for p in written] == before  # the same file every time


@pytest.mark.parametrize("name", NAMES)
def test_matplotlib_draws_every_chart(made, name):
    assert drawn(made[name], "png").startswith(b"\x89PNG")


def test_matplotlib_that_is_missing_is_named(tmp_path, solution, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(UsageError, match="matplotlib"):
        write_charts(solution, tmp_path / "plots")
    assert not (tmp_path / "plots").exists()


@pytest.mark.parametrize(
    ("limits", "expected"),
    [((0, 10), [0, 2, 4, 6, 8, 10]), ((-0.3, 0.31), [-0.2, 0, 0.2]), ((3, 3), [3])],
)
def test_ticks(limits, expected):
    assert ticks(*limits) == expected


def test_minus_is_a_minus():
    assert tick_text(-2.0) == "\N{MINUS SIGN}2"


def test_names_are_escaped():
    chart = Chart(
        "a < b", "x & y.", "<x>", "y", (-1, 2), (0, 2),
        (Bars(np.array([1.0, 2.0]), names=["<i>", "b"]), Points(np.zeros((1, 2)), titles=["<p>"]),
         Line(np.array([[0, np.nan], [1, 1]]), label="<l>")),
    )  # fmt: skip
    text = svg(chart, "t")
    ElementTree.fromstring(text)
    assert "<i>" not in text and "<p>" not in text and "<l>" not in text


def test_maps_hold_nan_and_inf():
    cells = Cells(
        np.arange(3.0), np.arange(2.0), np.array([[1, 2, np.inf], [np.nan, 100, 3]]), "px", logarithmic=True
    )
    assert cells.limits == (1, 100)
    assert cells.part(np.array([1.0, 10.0, 100.0, np.inf])).tolist() == pytest.approx([0, 0.5, 1, 1])
    chart = Chart("t", "t.", "x", "y", (0, 2), (0, 1), (cells,), picture=True)
    text = svg(chart, "t")
    assert text.count("<title>(") == 5  # a cell that is NaN is blank
    assert css_colour(1.0) in text


def test_colours_go_from_dark_to_light():
    light = [sum(int(css_colour(p)[i : i + 2], 16) for i in (1, 3, 5)) for p in np.linspace(0, 1, 9)]
    assert light == sorted(light)
    assert css_colour(-5) == css_colour(0)


def test_thinned():
    assert thinned(5).tolist() == [0, 1, 2, 3, 4]
    assert len(thinned(100_000, 50)) == 50 and thinned(100_000, 50)[-1] == 99_999
    assert len(thinned(0)) == 0


def test_enlargement_is_round():
    assert enlargement(np.full(100, 0.1), 1000.0) == pytest.approx(200)  # 4 % of 1000 px are 400 times .1 px


def test_the_mean_of_a_cell():
    uv = np.array([[1.0, 1.0]] * 4 + [[90.0, 1.0]] * 3)
    places, means = cell_means(uv, np.tile([1.0, -2.0], (7, 1)), (0, 120), (0, 100))
    # the second cell holds three points only
    assert places.tolist() == [[1, 1]] and means.tolist() == [[1, -2]]
