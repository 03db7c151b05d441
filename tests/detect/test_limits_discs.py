"""Limits of discs and their grids, each just below and just above."""

import cv2
import numpy as np
import pytest
from scipy import optimize

from camcal.detect import disc_grid, discs, grid
from camcal.detect.disc_fit import FittedDiscs
from camcal.detect.outlines import Squares
from camcal.detect.targets import base, circles, squares
from camcal.detect.targets.base import Detection
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


# ------------------------------------------------------------------------------------ outlines
def notched(depth, width=0.08, notches=8):
    """A disc with narrow notches, of which the outline has few points: round, but with less area than its ellipse."""
    xy = []
    for start in 2 * np.pi * np.arange(notches) / notches:
        arc = np.linspace(start + width, start + 2 * np.pi / notches - width, 300)
        xy += [[[(1 - depth) * np.cos(start), (1 - depth) * np.sin(start)]], np.c_[np.cos(arc), np.sin(arc)]]
    return (500 * np.concatenate(xy) + 600).astype(np.float32)[:, None]


def missing_area(outline):
    """By what part of it the ellipse of an outline's moments exceeds its area."""
    m = cv2.moments(outline)
    second = np.array([[m["mu20"], m["mu11"]], [m["mu11"], m["mu02"]]]) / m["m00"]
    return 4 * np.pi * np.sqrt(np.linalg.det(second)) / m["m00"] - 1


def test_the_area_of_an_outline_and_of_its_ellipse():
    for share, disc in ((LESS, True), (MORE, False)):
        depth = optimize.brentq(
            lambda d, s=share: missing_area(notched(d)) - s * discs.AREA_TOLERANCE, 0, 0.9
        )
        assert found(notched(depth)) == disc


def test_the_smallest_outline_deviates_by_pixels():
    """What the pixel grid does to a small square outline is allowed for in px, not in parts of the radius."""
    for share, disc in ((0.97, True), (1.03, False)):
        for radius in (8, 40):  # exact coordinates: the wave alone deviates
            t = np.arange(400) * 2 * np.pi / 400
            r = radius * (1 + share * np.sqrt(2) * (discs.ROUND + discs.PIXEL / radius) * np.cos(5 * t))
            outline = np.stack([r * np.cos(t), r * np.sin(t)], 1).astype(np.float32)[:, None] + 100
            assert found(outline) == disc


def disc_picture(radius, contrast, strip, size=(480, 640)):
    """A disc in the middle of a bright strip of a dark picture."""
    v, u = np.mgrid[: size[0], : size[1]] - np.reshape(size, (2, 1, 1)) / 2
    gray = np.where(np.abs(v) < strip / 2, 150.0, 40.0)
    return (gray - contrast * np.clip(radius - np.hypot(u, v) + 0.5, 0, 1)).astype(np.uint8)


@pytest.mark.parametrize(
    ("part", "radius", "contrast", "strip"), [(0, 5, 40, 24), (1, 15, 12, 100), (2, 40, 12, 480)]
)
def test_windows_of_the_threshold(monkeypatch, part, radius, contrast, strip):
    """The dark beside a strip lowers the mean of a larger window, a weak disc that of a smaller one."""
    gray = disc_picture(radius, contrast, strip)

    def seen():
        return any(np.abs(c - (320, 240)).max() < 1 for c in discs.find_discs(gray).centre)

    assert seen()
    monkeypatch.setattr(discs, "WINDOWS", discs.WINDOWS[:part] + discs.WINDOWS[part + 1 :])
    assert not seen()


# ------------------------------------------------------------------------------------ neighbours
def like(centre, radius=6.0):
    return discs.Discs(centre, np.repeat([radius * np.eye(2)], len(centre), 0))


@pytest.mark.parametrize(("share", "linked"), [(LESS, True), (MORE, False)])
def test_a_disc_beyond_a_hidden_one(share, linked):
    """The last column is farther away, by that factor on the geometric mean of both discs' measures."""
    centre = places(5, 3, 20.0)
    centre[:, 4, 0] += 20.0 * (share * discs.SAME - 1)
    other, _ = discs.links(like(centre.reshape(-1, 2)))
    assert (4 in other[3]) == linked


def test_a_disc_among_others_of_another_size():
    """Spots around the first disc are nearer than its neighbours: as many as are looked at leave none of its size."""
    centre = places(4, 3, 60.0).reshape(-1, 2)
    for spots, linked in ((grid.NEAREST - 4, True), (grid.NEAREST, False)):
        angle = 2 * np.pi * np.arange(spots) / spots
        spot = centre[0] + 10.0 * np.stack([np.cos(angle), np.sin(angle)], 1)
        shape = np.repeat([6.0, 1.0], [12, spots])[:, None, None] * np.eye(2)
        other, _ = discs.links(discs.Discs(np.r_[centre, spot], shape))
        assert (1 in other[0]) == (4 in other[0]) == linked
        assert (2 in other[1]) and (5 in other[1])


def test_the_nearest_marks_of_a_grid():
    """Between two marks lie others of another size, one fewer than are looked at, or as many."""
    ray = np.tile(np.array([[1.0, 0], [0, 1], [-1, 0], [0, -1]]), (2 + grid.NEAREST, 1, 1))
    for between, linked in ((grid.NEAREST - 1, True), (grid.NEAREST, False)):
        xy = np.r_[[[0.0, 0], [100.0, 0]], np.c_[np.linspace(30, 70, between), np.full(between, 20.0)]]
        size = np.r_[1.0, 1.0, np.full(between, 9.0)]
        marks = grid.Marks(xy, ray[: len(xy)], size, 1.5, alternating=False, closed=False)
        assert (grid.neighbours(marks)[0][0, 0] == 1) == linked


# ------------------------------------------------------------------------------------ boards
@pytest.mark.parametrize(("others", "seen"), [(grid.MOST_PIECES - 1, True), (grid.MOST_PIECES, False)])
def test_grids_that_are_examined(others, seen):
    """Larger grids come first."""
    uv = [places(5, 4, 20.0, (300.0 * k, 0.0)) for k in range(others)] + [places(4, 3, 20.0, (0.0, 500.0))]
    made = like(np.concatenate([g.reshape(-1, 2) for g in uv]))
    assert (disc_grid.find_board(made, False, (4, 3), 1.0)[0] is not None) == seen


def test_the_smallest_board_of_unknown_size():
    least = grid.LEAST_SIDE
    for rows, seen in ((least, True), (least - 1, False)):
        made = like(places(least + 2, rows).reshape(-1, 2))
        assert (disc_grid.find_board(made, False, None, 1.0)[0] is not None) == seen
        assert disc_grid.find_board(made, False, (least + 2, rows), 1.0)[0] is not None


@pytest.mark.parametrize("kind", [circles.Circles, squares.SquareGrid])
def test_fitted_discs_and_squares_of_a_board(monkeypatch, kind):
    """Of twenty found ones, so many fits are good."""
    target, count = kind(5, 4), 20
    least = round(base.LEAST_SEEN * count)
    centre = places(5, 4, 30.0).reshape(-1, 2)
    flat, zero = np.ones(count), np.zeros((count, 2, 2))
    for good, seen in ((least, True), (least - 1, False)):
        reasons = ("",) * good + ("uncertain",) * (count - good)
        made = disc_grid.Grid(np.arange(count), like(centre), 5, 4, False, 1.0)
        if kind is circles.Circles:
            fitted = FittedDiscs(like(centre), zero, flat, flat, flat, reasons)
            monkeypatch.setattr(circles, "fit_discs", lambda *_, f=fitted: f)
            answer = target._fitted(np.zeros((9, 9), np.uint8), made)
        else:
            corners = 30.0 * target.points[:, :2].reshape(count, 4, 2)[:, squares.CLOCKWISE] / target.pitch
            mask = np.array([not r for r in reasons])
            fitted = Squares(corners, np.zeros((count, 4, 2, 2)), mask, flat, flat)
            monkeypatch.setattr(squares.outlined, "fit_squares", lambda *_, f=fitted: (f, flat))
            answer = target._fitted(np.zeros((9, 9), np.uint8), made, corners)
        assert isinstance(answer, Detection) == seen


@pytest.mark.parametrize(("share", "plain"), [(0.97, True), (1.03, False)])
def test_what_is_around_a_disc(share, plain):
    """A ring of varying brightness around it, whose standard deviation is a part of the contrast."""
    v, u = np.mgrid[:200, :200]
    centre = np.array([[70.0, 100.0], [130.0, 100.0]])
    gray = np.full(u.shape, 200.0)
    made = like(centre, 10.0)
    step = (
        share * circles.PLAIN * 100 * np.sqrt(2)
    )  # the deviation of a sine is its amplitude over the root of two
    for c in centre:
        angle = np.arctan2(v - c[1], u - c[0])
        near = np.hypot(u - c[0], v - c[1]) < 31
        gray = np.where(near, 150 + step * np.sin(4 * angle), gray)
        gray = np.where(np.hypot(u - c[0], v - c[1]) < 12, 50, gray)
    mask, contrast = circles._on_plain_ground(gray.astype(np.uint8), made)
    assert contrast == pytest.approx(100, abs=2)
    assert mask.all() == plain and mask.any() == plain
