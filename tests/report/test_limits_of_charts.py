"""What charts and suggestions hold, each number just below and just above."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from camcal.assess.next_view import NextView
from camcal.model.camera import Camera
from camcal.report import bias, convergence, next_view
from camcal.report import yaml as yaml_text
from camcal.report.charts import board, files, lens
from camcal.report.charts.base import Bars, Chart
from camcal.report.html import pictures
from tests.report.test_next_view import held
from tests.sides import same_with_finer_and_not_with_coarser
from tests.solved import solved


@pytest.fixture(scope="module")
def good():
    return solved(views=4)


# ------------------------------------------------------------------------------------ charts
def field_at(degrees):
    """The distortion field of a lens that has none, whose picture's corners are at that angle."""
    fit = solved("brown:radial=1,decentering=0", views=3)
    f = np.hypot(319.5, 239.5) / np.tan(np.radians(degrees))
    lens_of = fit.camera.lens
    params = lens_of.from_values({"fx": f, "fy": f, "cx": 319.5, "cy": 239.5, "k1": 0.0})
    return lens.field(replace(fit, camera=Camera(lens_of, params, (640, 480)))).text


@pytest.mark.parametrize(("off", "omitted"), [(-0.1, False), (0.1, True)])
def test_rays_beyond_which_a_pinhole_shows_nothing(off, omitted):
    assert ("are omitted" in field_at(lens.PINHOLE_DEGREES + off)) == omitted


def test_a_distortion_of_nothing_is_not_enlarged():
    text = field_at(40.0)
    assert "at its true length" in text and "is 0.0 px" in text


def test_a_board_of_one_column(good):
    """It has a width on the chart of its shape: a part of its height."""
    ideal = np.c_[np.zeros(6), np.arange(6.0), np.zeros(6)]
    shaped = object.__new__(board.ShapedBoard)
    for name, value in {"ideal": ideal, "points": ideal + [0.01, 0, 0.02], "label": None}.items():
        object.__setattr__(shaped, name, value)
    data = SimpleNamespace(target={})
    chart = board.shape(SimpleNamespace(board=shaped, observations=data))
    assert chart.x == pytest.approx((-0.4, 0.4)) and chart.y == pytest.approx((-0.4, 5.4))


@pytest.mark.parametrize(("more", "named"), [(0, True), (1, False)])
def test_names_below_bars(more, named):
    pytest.importorskip("matplotlib")
    count = files.MOST_NAMES + more
    bars = Bars(np.ones(count), names=tuple(f"name{i}" for i in range(count)))
    chart = Chart("t", "", "x", "y", (-1.0, count), (0.0, 1.0), (bars,))
    assert (b"name3" in files._drawn(chart, "svg")) == named


def test_pictures_that_have_changed_are_named():
    names = [f"p{i}" for i in range(pictures.MOST_NAMED + 1)]
    assert "more" not in pictures.listed(names[:-1], pictures.MOST_NAMED)
    assert pictures.listed(names, pictures.MOST_NAMED).endswith("and 1 more")


def test_excesses_that_are_rounding():
    """Of a cost: half of the spacing of numbers of float64 about 1, and not more."""
    assert 0.5 * np.spacing(1.0) / 2 < convergence.FLOOR < np.spacing(1.0)


# ------------------------------------------------------------------------------------ suggestions
def test_pictures_up_to_which_an_uncertainty_is_searched_for(good, monkeypatch):
    """It is found with the last of them, or not at all."""
    most = next_view.MOST_PICTURES
    for needed, more in ((most, most), (most + 1, None)):
        search = SimpleNamespace(
            design=SimpleNamespace(sigma_0=1.0), best=lambda _: [], before=(9.0, 9.0),
            steps=lambda n=needed: (SimpleNamespace(worst=float(n - i)) for i in range(1, 200)),
        )  # fmt: skip
        search.pictures_until = lambda target, most, s=search: NextView.pictures_until(s, target, most)
        monkeypatch.setattr(next_view, "NextView", lambda *_, s=search, **__: s)
        answer, _ = next_view.suggest(good, target=0.5)
        assert answer["target"]["more_pictures"] == more and answer["target"]["tried"] == most


@pytest.mark.parametrize(("more", "drawn"), [(0, True), (1, False)])
def test_cells_of_a_drawn_target(good, monkeypatch, more, drawn):
    layers = next_view._flat_target(good, next_view.target_points(good), held())
    cells = sum(layer.filled for layer in layers)
    assert cells == 35  # of the 10 x 7 squares of 9 x 6 corners
    monkeypatch.setattr(next_view, "_MOST_CELLS", cells - more)
    layers = next_view._flat_target(good, next_view.target_points(good), held())
    assert any(layer.filled for layer in layers) == drawn


def test_points_along_the_edge_of_a_drawn_target(good, monkeypatch):
    """What a straight piece between two of them leaves of the curve: less than the pixel of a line."""
    bent = replace(good.camera, params=good.camera.params + np.r_[np.zeros(4), -0.3, np.zeros(4)])
    solution = replace(good, camera=bent)
    exact = np.linspace([-1.0, -1, 0], [9.0, -1, 0], 4001)
    curve = solution.camera.project(held(z=11.0).apply(exact))

    def sag():
        outline = next_view._flat_target(solution, next_view.target_points(solution), held(z=11.0))
        edge = next(layer.xy for layer in outline if layer.tone == "second")[: next_view._STEPS]
        t = np.linspace(0, 1, len(edge))
        at = np.linspace(0, 1, len(curve))
        straight = np.c_[np.interp(at, t, edge[:, 0]), np.interp(at, t, edge[:, 1])]
        return np.abs(straight - curve)[:, 1].max()

    same_with_finer_and_not_with_coarser(monkeypatch, next_view, "_STEPS", 2, 41, 1.0, sag)


def test_draws_of_the_bootstrap():
    """A standard deviation of them is known to five per cent, of half of them not."""
    assert 1 / np.sqrt(2 * bias.REPLICATES) <= 0.05 < 1 / np.sqrt(bias.REPLICATES)


# ------------------------------------------------------------------------------------ text
def test_lines_of_options_that_are_kept(monkeypatch):
    """They are forgotten beyond the limit; the text is the same."""
    monkeypatch.setattr(yaml_text, "_option_lines", {})
    monkeypatch.setattr(yaml_text, "MOST_OPTIONS", 3)
    options = {f"option-{i}": {"value": i, "origin": "default " * 9} for i in range(5)}
    sizes = []
    for name, entry in options.items():
        yaml_text._option(name, entry)
        sizes.append(len(yaml_text._option_lines))
    assert sizes == [1, 2, 3, 1, 2]
    text = yaml_text.dump_yaml({"options": options})
    monkeypatch.setattr(yaml_text, "MOST_OPTIONS", 1000)
    assert yaml_text.dump_yaml({"options": options}) == text
