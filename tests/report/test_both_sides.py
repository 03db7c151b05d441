"""Numbers that decide something in tables, charts and findings, each just below and just above."""

import io
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

from camcal.geometry import rotations
from camcal.model.pose import Pose
from camcal.report import lines, next_view, table
from camcal.report import yaml as yaml_text
from camcal.report.charts import base, coverage, residuals
from camcal.report.charts import lens as lens_charts
from camcal.report.charts import svg as drawing
from camcal.report.charts.base import Arrows, Bars, Cells, Chart
from camcal.report.doctor import pictures, remedies
from camcal.report.html import scene
from tests.sides import LESS, MORE
from tests.solved import solved


@pytest.fixture(scope="module")
def solution():
    return solved(views=8)


# ------------------------------------------------------------------------------------ scales and ticks
@pytest.mark.parametrize(
    ("ratio", "first"),
    [
        (LESS * base.LEAST_RATIO, [1.0, 2.0, 3.0, 4.0]),
        (MORE * base.LEAST_RATIO, [1.0, 2.0, 5.0]),
        (LESS * base.TWO_DECADES, [1.0, 2.0, 5.0, 10.0, 20.0, 50.0]),
        (MORE * base.TWO_DECADES, [1.0, 3.0, 10.0, 30.0, 100.0]),
    ],
)
def test_the_marks_of_a_scale_of_colours(ratio, first):
    cells = Cells(np.arange(2.0), np.arange(1.0), np.array([[1.0, ratio]]), "px", logarithmic=True)
    assert cells.marks == pytest.approx(first)


def test_round_numbers_but_for_rounding():
    for off, kept in ((0.9 * base.ROUNDED, 5.0), (1.1 * base.ROUNDED, 2.0)):
        assert base.round_down(5.0 * (1 - off)) == kept
    for off, step in ((0.9 * base.ROUNDED, 1.0), (1.1 * base.ROUNDED, 2.0)):
        made = base.ticks(0.0, 4.0 * (1 + off), wanted=4)
        assert made[1] - made[0] == step


def test_the_end_of_an_axis_is_a_tick_but_for_rounding():
    for off, count in ((0.9 * base.ON_TICK, 5), (1.1 * base.ON_TICK, 4)):
        assert len(base.ticks(0.0, 4.0 - off, wanted=4)) == count
        assert len(base.ticks(off, 4.0, wanted=4)) == count


# ------------------------------------------------------------------------------------ charts
def test_points_that_have_a_hull(solution):
    data = solution.observations
    for count, drawn in ((coverage.LEAST_HULL, True), (coverage.LEAST_HULL - 1, False)):
        some = replace(solution, observations=data.with_used(np.arange(len(data.uv)) < count))
        assert (coverage.image(some) is not None) == drawn


def test_the_circles_of_the_chart_of_tilts(solution, monkeypatch):
    for degrees in (0.9 * coverage.LEAST_REACH / 1.1, coverage.LEAST_REACH):
        turn = np.radians(degrees)
        monkeypatch.setattr(
            coverage,
            "board_normals",
            lambda facts, t=turn: np.tile([np.sin(t), 0, np.cos(t)], (len(facts.views), 1)),
        )
        assert coverage.tilts(solution).x[1] == pytest.approx(max(coverage.LEAST_REACH, 1.1 * degrees))
    assert coverage.CIRCLES[-1] < coverage.LEAST_REACH  # all circles are on the chart


def test_what_is_drawn_of_many_points():
    for count in (residuals.MOST, residuals.MOST + 1):
        assert len(residuals.thinned(count)) == residuals.MOST


def test_the_longest_arrow():
    """Of lengths of which the usual one is this part of the width, and of exact data."""
    for part, times in ((MORE * residuals.ARROW, 0.5), (LESS * residuals.ARROW, 1.0)):
        assert residuals.enlargement(np.full(9, 100 * part), 100.0) == times
    exact = residuals.enlargement(np.zeros(9), 100.0)
    assert exact == residuals.enlargement(np.full(9, residuals.LEAST_LENGTH), 100.0)
    assert exact > residuals.enlargement(np.full(9, 10 * residuals.LEAST_LENGTH), 100.0)


def test_points_of_a_cell_with_a_mean():
    for count, drawn in ((residuals.LEAST_OF_CELL, 1), (residuals.LEAST_OF_CELL - 1, 0)):
        uv = np.full((count, 2), 5.0)
        assert len(residuals.cell_means(uv, uv, (0.0, 120.0), (0.0, 120.0))[0]) == drawn


def test_points_of_a_histogram_and_of_rings(solution, monkeypatch):
    data = solution.observations
    monkeypatch.setattr(residuals.figures, "sigma_0", lambda _: 0.2)  # few points have none
    per_ring, rings = residuals.LEAST_POINTS, residuals.LEAST_RINGS

    def of(count):
        return replace(solution, observations=data.with_used(np.arange(len(data.uv)) < count))

    half = per_ring // 2  # of two coordinates each
    assert residuals.histogram(of(half)) is not None and residuals.histogram(of(half - 1)) is None
    assert residuals.by_radius(of(rings * per_ring)) is not None
    assert residuals.by_radius(of(rings * per_ring - 1)) is None
    band = residuals.by_radius(of(min(len(data.uv), 3 * residuals.RINGS * per_ring))).layers[1]
    assert len(band.xy) == 2 * min(
        residuals.RINGS, min(len(data.uv), 3 * residuals.RINGS * per_ring) // per_ring
    )


def test_a_lens_that_has_a_field_of_distortion(solution):
    assert lens_charts.field(solution) is not None
    pinhole = solved("pinhole", views=3)
    assert pinhole.camera.lens.size < lens_charts.PINHOLE_SIZE and lens_charts.field(pinhole) is None


# ------------------------------------------------------------------------------------ drawings
def chart(*layers, x=(0.0, 10.0), y=(0.0, 10.0), picture=False):
    return Chart("t", "t.", "x", "y", x, y, layers, picture)


def test_the_tallest_picture():
    width = drawing.WIDTH - drawing.LEFT - drawing.RIGHT
    for height, drawn in (
        (0.99 * drawing.TALLEST, 0.99 * drawing.TALLEST),
        (1.5 * drawing.TALLEST, drawing.TALLEST),
    ):
        made = drawing.svg(chart(x=(0, width), y=(0, height), picture=True), "n")
        assert f'height="{drawn:.1f}"' in made


def test_the_shortest_arrow_with_a_head():
    frame = drawing._Frame(chart(x=(0, 100), y=(0, 100), picture=True), 0, 0, 100.0, 100.0)
    for length, strokes in ((MORE * drawing.LEAST_HEAD, 2), (LESS * drawing.LEAST_HEAD, 1)):
        made = drawing._arrows(Arrows(np.zeros((1, 2)), np.array([[length, 0.0]])), frame)
        assert made.count("M") == strokes


def test_names_below_bars():
    """On narrow screens every other name is left out where there are more than a few."""
    for count, odd in ((drawing.MANY_NAMES, False), (drawing.MANY_NAMES + 1, True)):
        bars = Bars(np.ones(count), names=[str(i) for i in range(count)])
        assert (' odd"' in drawing.svg(chart(bars, x=(-1, count)), "n")) == odd
    for length, whole in ((drawing.LONGEST_NAME, True), (drawing.LONGEST_NAME + 1, False)):
        bars = Bars(np.ones(1), names=["n" * length])
        assert (f">{'n' * length}</text>" in drawing.svg(chart(bars, x=(-1, 1)), "n")) == whole


def test_a_narrow_chart_has_three_ticks():
    for times, wanted in ((1.0, drawing.LEAST_TICKS), (drawing.LEAST_TICKS + 1.0, drawing.LEAST_TICKS + 1)):
        frame = drawing._Frame(chart(), 0, 0, times * drawing.TICK_WIDTH, times * drawing.TICK_HEIGHT)
        assert drawing._ticks(frame) == (base.ticks(0, 10, wanted=wanted), base.ticks(0, 10, wanted=wanted))


def test_the_narrowest_bar():
    frame = drawing._Frame(chart(x=(0, 10), y=(0, 1)), 0, 0, 100.0, 100.0)
    for width, drawn in (
        (drawing.LEAST_BAR + drawing.BAR_GAP + 1, drawing.LEAST_BAR + 1),
        (0.1, drawing.LEAST_BAR),
    ):
        made = drawing._bars(Bars(np.ones(1), edges=np.array([0, width / 10])), frame)
        assert f'width="{drawn:.1f}"' in made


# ------------------------------------------------------------------------------------ findings
def test_pictures_enough():
    for count, said in ((pictures.ENOUGH, False), (pictures.ENOUGH - 1, True)):
        assert bool(list(pictures._count(range(count)))) == said


def test_a_fault_of_many_pictures(monkeypatch):
    for share, grade in ((LESS * pictures.MANY, "note"), (MORE * pictures.MANY, "better")):
        monkeypatch.setattr(pictures, "faults", lambda found, s=share: [("blurred", "m", s)])
        monkeypatch.setitem(pictures.REMEDIES, "blurred", "r")
        assert [f.grade for f in pictures._quality(None)] == [grade]


def test_a_large_effect():
    def tests(p, effect):
        return {"bias": {"tests": [{"name": "radius", "p_corrected": p, "effect": effect}]}}

    sure, large = LESS * remedies.BY_CHANCE, MORE * remedies.LARGE_EFFECT
    assert remedies.large_effects(tests(sure, large))
    assert not remedies.large_effects(tests(MORE * remedies.BY_CHANCE, large))
    assert not remedies.large_effects(tests(sure, LESS * remedies.LARGE_EFFECT))


def test_a_place_in_the_picture():
    for off, words in ((LESS * next_view.CENTRAL, "middle"), (MORE * next_view.CENTRAL, "right")):
        assert words in next_view._place(0.5 + off, 0.5)


def test_a_target_that_faces_the_camera():
    square = np.array([[x, y, 0.0] for y in (-1, 1) for x in (-1, 1)])
    far = np.array([0.0, 0.0, 5.0])
    for degrees, facing in (
        (LESS * next_view.FACING_DEGREES, True),
        (MORE * next_view.FACING_DEGREES, False),
    ):
        turned = Pose(rotations.exp(np.radians([0.0, degrees, 0.0])), far)
        assert (next_view._tilt(square, turned) == "facing the camera") == facing
    for part, named in ((LESS * next_view._ASIDE, False), (MORE * next_view._ASIDE, True)):
        axis = np.array([np.sqrt(1 - part**2), part, 0.0])  # the normal leans by `part` to the side
        said = next_view._tilt(square, Pose(rotations.exp(np.radians(30) * axis), far))
        assert bool({"left", "right"} & set(said.split())) == named


def test_lines_of_one_direction(monkeypatch):
    """Half of the lines are turned to each side: the mean of exp(2iφ) is cos 2φ."""
    fit = SimpleNamespace(camera=None, used=np.ones(2, bool), assumed=(), undetermined=(), converged=True)
    for cosine, said in ((MORE * lines.ONE_DIRECTION, True), (LESS * lines.ONE_DIRECTION, False)):
        turn = math.acos(cosine) / 2
        monkeypatch.setattr(lines.straightness, "directions", lambda *_, t=turn: np.array([t, -t]))
        assert ("one-direction" in {w["code"] for w in lines._warnings(fit, range(2))}) == said


# ------------------------------------------------------------------------------------ tables, documents
def test_decimal_places_of_a_sigma():
    for exponent, places in (
        (table.MOST_PLACES - 2, table.MOST_PLACES - 1),
        (table.MOST_PLACES, table.MOST_PLACES),
    ):
        value, sigma = table.with_sigma(1.0, 10.0**-exponent)
        assert len(value.split(".")[1]) == len(sigma.split(".")[1]) == places


def test_views_of_a_table():
    def rows(used, others=0):
        view = {"points": 9, "rejected_points": 0, "rms_point": 0.1, "reason": ""}
        given = [view | {"id": str(i), "status": "used"} for i in range(used)]
        given += [view | {"id": f"x{i}", "status": "not_found"} for i in range(others)]
        made = table._views(given)
        return made.row_count, made.title

    assert rows(table.ALL_VIEWS)[0] == table.ALL_VIEWS
    assert rows(table.ALL_VIEWS + 1)[0] == table.WORST_VIEWS
    few, many = (rows(table.ALL_VIEWS, table.WORST_VIEWS + more) for more in (0, 1))
    assert few[0] == many[0] == 2 * table.WORST_VIEWS
    assert "first" not in few[1] and f"(first {table.WORST_VIEWS})" in many[1]


def test_names_of_turned_views():
    for count, rest in ((table.NAMED, False), (table.NAMED + 1, True)):
        made = table.board_table({"kind": "flat", "turned": [f"view{i}" for i in range(count)]})
        console = Console(width=200, file=io.StringIO())
        console.print(made)
        text = console.file.getvalue()
        assert ("..." in text) == rest and text.count("view") == min(count, table.NAMED) + 1  # and the word


def test_a_short_mapping_is_on_one_line():
    room = yaml_text.LINE - len(repr("a")) - len("b") - 4
    found = [
        yaml_text._short({"b": "x" * count}, yaml_text.LINE) >= 0 for count in range(room - 20, room + 20)
    ]
    last = found.index(False) + room - 20 - 1
    for count, on_one in ((last, True), (last + 1, False)):
        text = yaml_text.dump_yaml({"a": {"b": "x" * count}, "z": "x" * yaml_text.LINE})
        assert ("a: {b: " in text) == on_one


def test_boards_that_are_drawn(solution, monkeypatch):
    views = len(solution.poses)
    for most in (views, views - 1):
        monkeypatch.setattr(scene, "MOST", most)
        assert len({s.title for s in scene.shapes(solution) if s.kind == "board"}) == most
