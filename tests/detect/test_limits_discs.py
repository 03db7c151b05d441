"""Limits of discs and their grids, each just below and just above."""

import numpy as np
import pytest

from camcal.detect import disc_grid, discs
from tests.detect.test_limits_search import places
from tests.sides import LESS, MORE


def ellipse(a, b, angle=0.0, wave=0.0, points=400):
    t = np.arange(points) * 2 * np.pi / points
    r = 1 + wave * np.cos(5 * t)
    xy = np.stack([a * r * np.cos(t), b * r * np.sin(t)], 1) @ np.array(
        [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
    )
    return np.round(xy + 500).astype(np.int32)[:, None]


def found(outline):
    return discs.ellipse_of(outline) is not None


def test_the_outline_of_a_disc():
    """Long axes, so that whole pixels hardly change the shape."""
    ratio = discs.MOST_SLENDER
    assert found(ellipse(400, 400 * 1.01 / ratio)) and not found(ellipse(400, 400 * 0.99 / ratio))
    # a wave of amplitude w deviates by w / sqrt 2 of the radius
    most = (discs.ROUND + discs.PIXEL / 400) * np.sqrt(2)
    assert found(ellipse(400, 400, wave=0.97 * most)) and not found(ellipse(400, 400, wave=1.03 * most))


def test_the_points_of_an_outline(monkeypatch):
    """Regular polygons, which are round enough for a disc."""
    for points, disc in ((discs.LEAST_OUTLINE, True), (discs.LEAST_OUTLINE - 1, False)):
        t = np.arange(points) * 2 * np.pi / points
        outline = (100 * np.stack([np.cos(t), np.sin(t)], 1)).astype(np.float32)[:, None]
        assert found(outline) == disc
    monkeypatch.setattr(discs, "LEAST_OUTLINE", 0)
    assert found(outline)


def test_two_outlines_around_one_centre():
    for share, kept in ((LESS, 1), (MORE, 2)):
        centre = np.array([[50.0, 50], [50 + share * discs.CONCENTRIC * 10, 50]])
        made = discs.Discs(centre, np.array([20 * np.eye(2), 10 * np.eye(2)]))
        assert len(discs.distinct(made)) == kept


def test_the_number_of_discs():
    most = discs.MOST_DISCS
    side = int(np.ceil(np.sqrt(most + 1)))
    centre = places(side, side).reshape(-1, 2)[: most + 1]
    made = discs.Discs(centre, np.repeat([5 * np.eye(2)], most + 1, 0))
    assert len(discs.distinct(made)) == most and len(discs.distinct(made.take(np.arange(most)))) == most


def test_a_disc_that_is_darker_than_its_surroundings():
    """Seven of eight samples around it: the darkest may lie on another object."""
    y, x = np.mgrid[0:61, 0:61]
    far = np.hypot(x - 30, y - 30)
    made = discs.Discs(np.array([[30.0, 30]]), np.array([10 * np.eye(2)]))
    for step, dark in ((discs.THRESHOLD, False), (discs.THRESHOLD + 1, True)):
        gray = np.where(far < 10, 100, 100 + step).astype(np.uint8)
        assert discs._dark_inside(gray, made)[0] == dark
    # where that is looked at: a ring of the same grey value reaches so far, or a pixel farther
    for reach, dark in ((discs.AROUND * 10 - 2.0, True), (discs.AROUND * 10 + 2.0, False)):
        gray = np.where(far < reach, 100, 200).astype(np.uint8)
        assert discs._dark_inside(gray, made)[0] == dark


@pytest.mark.parametrize(
    ("staggered", "lines", "shows"), [(False, 1, False), (False, 2, True), (True, 2, False), (True, 3, True)]
)
def test_rows_too_few_to_show_where_the_next_would_be(staggered, lines, shows):
    """One row, or two of a staggered grid, at the upper border; the ends of the rows show where they would go on."""
    for x, y, leaves in ((100.0, 8.0, shows), (100.0, 150.0, False), (252.0, 150.0, True)):
        uv = places(8, lines, 20.0, (x, y)).reshape(-1, 2)
        made = discs.Discs(uv, np.repeat([5.0 * np.eye(2)], len(uv), 0))
        grid = disc_grid.Grid(np.arange(len(uv)), made, 8, lines, staggered, 1.0)
        assert grid.leaves((400, 400)) == leaves, (x, y)


def test_a_grid_of_discs_that_leaves_the_picture():
    """Of four discs of the next row, moved inwards: half of them outside are not enough."""
    for outside, leaves in ((2, False), (3, True)):
        assert disc_grid.OUTSIDE == 0.5
        uv = places(4, 4, 20.0, (100.0, 45.0))
        uv[0, :outside, 1] -= 18.0  # the next row is 36 px higher
        made = discs.Discs(uv.reshape(-1, 2), np.repeat([5.0 * np.eye(2)], 16, 0))
        grid = disc_grid.Grid(np.arange(16), made, 4, 4, False, 1.0)
        assert grid.leaves((400, 400)) == leaves


def test_the_area_of_a_disc():
    for share, disc in ((0.99, False), (1.01, True)):
        t = np.arange(200) * 2 * np.pi / 200
        radius = np.sqrt(share * discs.LEAST_AREA / np.pi)
        outline = (50 + radius * np.stack([np.cos(t), np.sin(t)], 1)).astype(np.float32)[:, None]
        assert found(outline) == disc


@pytest.mark.parametrize(("share", "linked"), [(0.99, True), (1.01, False)])
def test_neighbouring_discs(share, linked):
    """The last disc of each row is larger."""
    centre = places(5, 3, 20.0).reshape(-1, 2)
    shape = np.repeat([6.0 * np.eye(2)], 15, 0)
    larger = shape.copy()
    larger[[4, 9, 14]] *= discs.SPREAD * share
    other, _ = discs.links(discs.Discs(centre, larger))
    assert (4 in other[3]) == linked
