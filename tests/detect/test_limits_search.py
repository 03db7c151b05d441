"""Numbers that decide something in the search for a grid of corners or discs, each just below and just above."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import norm

from camcal.detect import (
    board_points,
    candidates,
    edge_blur,
    evenness,
    grid,
    lattice,
    search,
    shading,
    squares,
)
from camcal.detect.grid import Marks
from camcal.detect.lattice import Lattice
from camcal.detect.search import Found
from camcal.detect.squares import Squares
from tests.sides import LESS, MORE


def places(columns, rows, step=20.0, at=(100.0, 100.0)):
    """A square grid (rows, columns, 2), px."""
    return step * np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), -1).astype(float) + at


def checkerboard(square=20, count=8):
    """A picture of alternating squares, white first, and its inner corners."""
    gray = np.kron(np.where(np.indices((count, count)).sum(0) % 2, 40.0, 200.0), np.ones((square, square)))
    return gray.astype(np.float32), places(count - 1, count - 1, square, (square - 0.5,) * 2)


# ------------------------------------------------------------------------------------ levels of the search
def test_a_picture_that_is_enlarged():
    side = search.ENLARGED
    assert 0.5 in search.levels((side, side)) and 0.5 not in search.levels((side, side + 1))


def test_the_smallest_reduced_picture():
    for short, levels in ((2 * search.LEAST_PIXELS, True), (2 * search.LEAST_PIXELS - 1, False)):
        assert (2.0 in search.levels((short, 2 * search.LONG_SIDES[0]))) == levels


@pytest.mark.parametrize(("part", "tried"), [(LESS, False), (MORE, True)])
def test_a_level_that_may_take_too_long(monkeypatch, part, tried):
    """The first level takes a second; the second has four times the pixels, and each may take SLOWER times as long."""
    now = [0.0]
    shapes = []

    def level(picture, *_):
        shapes.append(picture.shape)
        now[0] += 1.0
        return []

    monkeypatch.setattr(search, "levels", lambda _: [2.0, 1.0])
    monkeypatch.setattr(search, "clock", lambda: now[0])
    monkeypatch.setattr(search, "_at_level", level)
    search.search(
        np.random.default_rng(0).integers(0, 255, (64, 64)).astype(np.uint8), 1 + part * 4 * search.SLOWER
    )
    assert len(shapes) == 1 + tried


def pieces_taken(monkeypatch, pieces, size=None, alternation=1.0):
    """How many of the pieces of a grid are taken; each is a full grid of its own."""
    gray, uv = checkerboard()
    monkeypatch.setattr(
        search, "find_candidates", lambda _: SimpleNamespace(marks=SimpleNamespace(xy=uv.reshape(-1, 2)))
    )
    monkeypatch.setattr(search.grid, "neighbours", lambda *_: ())
    monkeypatch.setattr(search.grid, "grow", lambda *_: pieces)
    monkeypatch.setattr(search, "complete", lambda _, lattice, *__: lattice)
    monkeypatch.setattr(search.Squares, "alternation", lambda _: alternation)
    return len(search._at_level(gray, 1.0, size))


def test_pieces_that_are_examined(monkeypatch):
    index = np.arange(49).reshape(7, 7)
    most = grid.MOST_PIECES
    assert [pieces_taken(monkeypatch, [index] * n) for n in (most, most + 1)] == [most, most]
    assert pieces_taken(monkeypatch, [index], alternation=search.ALTERNATING) == 1
    assert pieces_taken(monkeypatch, [index], alternation=LESS * search.ALTERNATING) == 0
    for count, taken in ((20, 1), (19, 0)):  # of a board of fifty corners
        assert search.SEED * 50 == 20
        part = np.where(np.arange(28).reshape(4, 7) < count, index[:4], -1)
        assert pieces_taken(monkeypatch, [part], (10, 5)) == taken


# ------------------------------------------------------------------------------------ grids
def test_corners_that_show_where_a_board_ends():
    """Eight to a side and all over it."""
    for gone, whole in ((2, True), (3, False)):
        assert search.NEARLY_ALL == (8 - 2) / 8
        uv = places(8, 8)
        uv[0, 1 : 1 + gone] = np.nan
        assert Found(Lattice(uv), 1.0, False, np.zeros((9, 9))).whole == whole
        uv = places(8, 10)
        inner = np.argwhere(np.ones((8, 6)))[: 20 + (gone == 3)] + 1
        uv[tuple(inner.T)] = np.nan
        assert Found(Lattice(uv), 1.0, False, np.zeros((9, 9))).whole == whole


def test_a_board_that_goes_on_beyond_the_picture():
    """Ten columns whose next row upwards lies outside for some of them."""
    for outside, goes_on in ((3, False), (4, True)):
        assert search.BEYOND * 10 == 3
        uv = places(10, 6, 20.0, (100.0, 100.0))
        uv[0, :outside, 1] = (
            60 + search.BORDER - 0.1
        )  # one step from the row below: the next is at BORDER - .1
        uv[1, :outside, 1] = (
            0.5 * (uv[0, :outside, 1] + search.BORDER + uv[0, :outside, 1] - search.BORDER) + 60.0
        )
        assert search._open_ended(Lattice(uv), (400, 400)) == goes_on


def test_the_border_of_a_picture():
    for row, goes_on in ((MORE * search.BORDER, False), (LESS * search.BORDER, True)):
        assert search._open_ended(Lattice(places(6, 5, 20.0, (100.0, 20.0 + row))), (400, 400)) == goes_on


def test_stray_corners_beside_a_grid():
    """Seven tenths of ten corners are seven."""
    cut = Lattice(places(12, 10))
    for extra, hidden in ((7, False), (8, True)):
        assert search.HALF_HIDDEN * 10 == 7
        uv = places(12, 11)
        uv[10, extra:] = np.nan
        assert search._half_rows(Lattice(uv), cut) == hidden


def test_a_grid_on_a_screen_behind_the_board():
    largest = SimpleNamespace(whole=True, area=100.0)
    for part, behind in ((LESS, True), (MORE, False)):
        found = SimpleNamespace(area=part * search.BACKGROUND * 100)
        assert search._in_the_background(found, largest) == behind


def test_rows_and_columns_at_a_slant():
    for share, usable in ((MORE, True), (LESS, False)):
        angle = np.arcsin(share * lattice.LEAST_SINE)
        uv = places(4, 3, 1.0) @ np.array([[20.0, 0], [20 * np.cos(angle), 20 * np.sin(angle)]])
        assert Lattice(uv).usable.all() == usable and Lattice(uv).usable.any() == usable


# ------------------------------------------------------------------------------------ squares
def test_the_edge_between_two_corners():
    """An edge with a part of the contrast of its corners."""
    gray = np.where(np.arange(60) < 30, 0.0, 100.0)[None].repeat(60, 0).astype(np.float32)
    for share, shown in ((LESS, True), (MORE, False)):
        size = np.full(2, share * 100 / squares.CLEAR)
        marks = Marks(np.array([[29.5, 10.0], [29.5, 50.0]]), np.zeros((2, 4, 2)), size, 4.0, True, True)
        # the step down: clockwise of it, which is to the left, lies the dark side, as after an odd ray
        assert squares.shown_edges(gray, marks, np.array([0]), np.array([1]), np.array([1]))[0] == shown


def test_the_sides_of_a_short_edge():
    """A dark line of 2 px: its sides are looked at beyond it."""
    reach = squares.BESIDE_PX
    assert reach / squares.BESIDE > 8
    for far, shown in ((reach - 1.0, True), (reach + 1.0, False)):
        gray = np.full((40, 40), 50.0, np.float32)
        gray[:, 20 + int(np.ceil(far)) :] = 100.0
        marks = Marks(
            np.array([[20.0, 16.0], [20.0, 24.0]]), np.zeros((2, 4, 2)), np.full(2, 50.0), 4.0, True, True
        )
        assert squares.shown_edges(gray, marks, np.array([0]), np.array([1]), np.array([1]))[0] == shown


def test_a_corner_that_is_missing_in_a_grid():
    gray, uv = checkerboard()
    for off, filled in ((0.99 * squares.REACH, True), (1.01 * squares.REACH, False)):
        holed = uv.copy()
        holed[3, 3] = np.nan
        weak = uv.reshape(-1, 2).copy()
        weak[24] += (20 * off, 0.0)
        made = squares.complete(gray, Lattice(holed), SimpleNamespace(weak=weak))
        assert np.isfinite(made.uv).all() == filled


@pytest.mark.parametrize(("share", "filled"), [(1.02, True), (0.98, False)])
def test_the_contrast_of_a_missing_corner(share, filled):
    gray, uv = checkerboard()
    part = gray[60:100, 60:100]
    part[:] = 120 + share * squares.CLEAR * (part - 120)
    holed = uv.copy()
    holed[3, 3] = np.nan
    made = squares.complete(gray, Lattice(holed), SimpleNamespace(weak=uv.reshape(-1, 2)))
    assert np.isfinite(made.uv).all() == filled


def test_squares_that_differ_from_their_neighbours():
    """One of 6 x 6 squares that differs from the four beside it by a part of what is usual."""
    for share, least in ((MORE, 1.0), (LESS, 1 - 4 / 60)):
        value = np.where(np.indices((6, 6)).sum(0) % 2, 0.0, 100.0)
        value[2, 2] = share * 100 * squares.UNLIKE
        assert Squares(value).alternation() == pytest.approx(least)


# ------------------------------------------------------------------------------------ candidates
def sectors(angles, levels=(100.0, 0.0, 100.0, 0.0), radius=60.0):
    """Whether a ring of 60 px shows four sectors, of these levels, that begin at these angles."""
    y, x = np.mgrid[-65:66, -65:66]
    theta = np.arctan2(y, x) % (2 * np.pi)
    gray = np.asarray(levels)[np.searchsorted(angles, theta) - 1].astype(np.float32)
    return len(candidates._sectors(gray, np.array([[65.0, 65]]), radius)[0]) == 1


FOUR = 0.3 + np.arange(4) * np.pi / 2


def test_sectors_that_are_bent():
    """One of the four edges is turned; samples lie .025 rad apart."""
    for bend, kept in ((candidates.MOST_BEND - 0.03, True), (candidates.MOST_BEND + 0.03, False)):
        assert sectors(FOUR - (0, 0, bend, 0)) == kept


def test_the_narrowest_sector():
    for width, kept in ((candidates.LEAST_SECTOR + 0.03, True), (candidates.LEAST_SECTOR - 0.03, False)):
        assert sectors(np.array([0.3, 0.3 + width, 0.3 + np.pi, 0.3 + width + np.pi])) == kept


def test_opposite_sectors_that_are_alike():
    """Two neighbouring sectors differ from the mean by c, the opposite ones by 1: they correlate by 2c / (1 + c²)."""
    for share, kept in ((1.05, True), (0.95, False)):
        r = share * candidates.OPPOSITE
        c = (1 - np.sqrt(1 - r**2)) / r
        assert sectors(FOUR, 100 + 50 * np.array([1, -1, c, -c])) == kept


def test_a_maximum_near_its_pixel():
    """x y + s (x + y), whose saddle is at (-s, -s); the factor puts the largest -det(Hessian) at the origin."""
    y, x = np.mgrid[-15.0:16, -15.0:16]
    most = candidates.MOST_STEP
    for s, place in ((0.9 * most, 0.9 * most), (1.1 * most, most)):
        smooth = x * y * (1 - (x**2 + y**2) / 900) + s * (x + y)
        found = candidates._saddles(smooth.astype(np.float32)) - 15
        np.testing.assert_allclose(found, [[-place, -place]], atol=0.01)


# ------------------------------------------------------------------------------------ points of a board
def test_a_fitted_point_that_is_another_corner():
    points = places(6, 5, 1.0, (0, 0)).reshape(-1, 2)
    for share, kept in ((0.99, True), (1.01, False)):
        known = board_points.Known.of(len(points))
        known.good[:] = True
        known.uv = 20 * points
        known.uv[14] += (0.0, share * board_points.STRAY * 20)
        known.drop_strays(points, 1.0)
        assert known.good[14] == kept


def test_points_in_a_row_map_nothing():
    """The second singular value of the equations falls as the points come to lie on one line."""
    for aside, certain in ((0.3, True), (1e-4, False)):
        points = np.stack([np.arange(12.0), aside * (np.arange(12) % 3)], 1)
        assert board_points.from_points(points[:1], points, 20 * points + 5)[2][0] == certain
        back = board_points.board_from_pixel(points, 20 * points + 5)(20 * points[:, None] + 5)
        assert np.isfinite(back).all() == certain


def test_the_markers_that_give_a_place():
    """The farthest of those around a point counts, and the next one does not."""
    count = board_points.SUPPORT
    corners = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    board = corners + np.array([[3.0 + 0.2 * k, 0.1 * k**2] for k in range(count + 1)])[:, None]
    at = np.array([[2.0, 0.5]])

    def located(wrong):
        uv = 20.0 * board + 7
        if wrong is not None:
            uv[wrong] += 1.0
        return board_points.locate(at, board, uv, 10.0)[1][0]

    assert np.abs(located(count - 1) - located(None)).max() > 1e-3
    np.testing.assert_allclose(located(count), located(None))


# ------------------------------------------------------------------------------------ contrast
def test_neighbours_of_like_contrast():
    """Alternately more and less, so that each differs from its neighbours by as much."""
    centre = places(8, 8).reshape(-1, 2)
    odd = np.indices((8, 8)).sum(0).ravel() % 2
    for share, uneven in ((0.99, False), (1.01, True)):
        # contrasts 1 and 1 + d, of mean (the median of an even number) 1 + d / 2: d > limit (1 + d / 2)
        limit = share * evenness.UNLIKE_NEIGHBOURS
        contrast = 1.0 + odd * limit / (1 - limit / 2)
        assert evenness.unevenly_dark(contrast, centre) == uneven


def test_neighbours_whose_contrast_counts():
    """In a row, two to each side: a step of the contrast stands out where it reaches most of the neighbours."""
    assert evenness.AROUND == 4
    centre = np.c_[np.arange(40.0) * 20, np.zeros(40)]
    for period, uneven in ((1, True), (8, False)):
        contrast = 1.0 + 0.2 * ((np.arange(40) // period) % 2)
        assert evenness.unevenly_dark(contrast, centre) == uneven


# ------------------------------------------------------------------------------------ shading
def test_a_plane_or_a_curved_shading():
    """Levels of a parabola: below the number for a quadratic surface a plane is fitted, below half of it nothing."""
    least = shading.LEAST_CORNERS
    uv = np.random.default_rng(3).uniform(0, 100, (least, 2))
    level = 50 + 0.01 * (uv[:, 0] - 50) ** 2
    right = 0.02 * (uv[:, 0] - 50)

    def slope(count):
        sound = np.arange(least) < count
        return shading.slopes(uv, level, np.full(least, 30.0), sound)[:, 0, 0]

    np.testing.assert_allclose(slope(least), right, atol=1e-6)
    assert np.ptp(slope(least - 1)) < 1e-9 and np.ptp(slope(least // 2)) < 1e-9
    assert slope(least // 2).any() and not slope(least // 2 - 1).any()


def test_unusual_residuals():
    noise = np.ones(9)
    for share, unusual in ((LESS, False), (MORE, True)):
        noise[0] = share * shading.UNUSUAL
        assert shading.unusual(noise).tolist() == [unusual] + [False] * 8


# ------------------------------------------------------------------------------------ edges
def test_a_faint_edge_does_not_count_for_the_blur():
    """Five edges of which two, blurred by more, have a part of the others' step."""
    x = np.arange(80.0)
    blurs = np.array([1.0, 1.0, 2.0, 3.0, 3.0])
    for share, blur in ((0.97, 1.0), (1.03, 2.0)):
        steps = np.array([100.0] * 3 + [share * 100 * edge_blur.LEAST_STEP] * 2)
        rows = 100 + steps[:, None] * norm.cdf((x - 40) / blurs[:, None])
        gray = np.repeat(rows, 4, 0).astype(np.float32)
        start = np.stack([np.full(5, 40.0), 4 * np.arange(5)], 1)
        across = np.tile([30.0, 0.0], (5, 1))
        assert edge_blur._blurs(gray, start, start + (0.0, 2.0), across, across) == pytest.approx(
            blur, abs=0.15
        )


# ------------------------------------------------------------------------------------ further limits of grids
def test_candidates_that_are_one_corner():
    for share, kept in ((LESS, [False, True]), (MORE, [True, True])):
        xy = np.array([[50.0, 50.0], [50 + share * candidates.SINGLE, 50.0]])
        assert candidates._single(xy, np.array([1.0, 2.0])).tolist() == kept


def test_points_of_a_block_that_is_even():
    """A block of nine with so many points; of fewer nothing is said."""
    rough = places(3, 3) + np.random.default_rng(0).normal(0, 2, (3, 3, 2))
    for count, known in ((evenness.LEAST_POINTS, True), (evenness.LEAST_POINTS - 1, False)):
        uv = rough.copy()
        uv.reshape(-1, 2)[[0, 4, 8, 2][: 9 - count]] = np.nan
        assert (evenness.unevenness(uv) > 0) == known


def test_the_corners_of_a_board_that_was_asked_for():
    seen = round(50 * search.LEAST_SEEN)
    for count, fits in ((seen, True), (seen - 1, False)):
        uv = places(10, 5)
        uv.reshape(-1, 2)[count:] = np.nan
        made = Found(Lattice(uv), 1.0, False, np.zeros((9, 9)))
        assert made.fits((10, 5)) == made.fits((5, 10)) == fits


def test_the_smallest_grid_of_corners(monkeypatch):
    """One corner less to a side where the size was asked for."""
    least = grid.LEAST_SIDE
    index = np.arange(49).reshape(7, 7)
    assert pieces_taken(monkeypatch, [index[:least]]) == 1
    assert pieces_taken(monkeypatch, [index[: least - 1]]) == 0
    assert pieces_taken(monkeypatch, [index[: least - 1]], (7, 2)) == 1
    assert pieces_taken(monkeypatch, [index[: least - 2]], (7, 1)) == 0
