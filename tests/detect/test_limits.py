"""Thresholds of the search for boards, from both sides."""

import cv2
import numpy as np
import pytest
from scipy import optimize

from camcal.detect import candidates, discs, search, shading
from camcal.detect.board_points import LOCAL_POINTS, Known
from camcal.detect.candidates import Candidates
from camcal.detect.grid import Marks
from camcal.detect.grid_fit import sharp_corners
from camcal.detect.lattice import Lattice, trim
from camcal.detect.no_board import why_nothing
from camcal.detect.recognition import decide, measure
from camcal.detect.recognition.look import Sight
from camcal.detect.search import Found
from camcal.detect.squares import Squares, complete
from camcal.detect.targets.base import Detection, Miss
from camcal.detect.targets.checkerboard import Checkerboard, find_any
from camcal.geometry import homography
from tests.detect import drawing
from tests.detect.scenes import make


def grid(columns=9, rows=6, square=20.0, missing=(), origin=(60.0, 50.0)):
    uv = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), -1) * square + origin
    uv.reshape(-1, 2)[list(missing)] = np.nan
    return Lattice(uv)


def found(lattice, open_ended=False):
    return Found(lattice, 1.0, open_ended, np.zeros((1, 1)))


def inner(count):
    """So many corners inside a 9x6 grid, no two of them side by side."""
    every = [9 * r + c for r in range(1, 5) for c in range(1, 8) if (r + c) % 2] + [20, 22, 24]
    return every[:count]


def test_a_named_board_may_hide_a_fifth():
    least = 44
    assert found(grid(missing=inner(54 - least))).fits((6, 9))
    assert not found(grid(missing=inner(54 - least + 1))).fits((9, 6))
    assert not found(grid()).fits((8, 6))


def test_a_size_is_certain_where_three_quarters_of_each_side_are_seen():
    hidden = 2
    assert found(grid(missing=range(hidden))).whole
    assert not found(grid(missing=range(hidden + 1))).whole
    assert not found(grid(), open_ended=True).whole
    scattered = 13
    assert found(grid(missing=inner(scattered))).whole and not found(grid(missing=inner(scattered + 1))).whole


def test_what_a_screen_behind_the_board_shows_is_no_board():
    largest = found(grid(square=40.0))
    for share, background in ((0.9, True), (1.1, False)):
        other = found(grid(square=40.0 * np.sqrt(0.1 * share)))
        assert search._in_the_background(other, largest) == background
    cut = found(grid(square=40.0), open_ended=True)  # it may be a part of the same board
    assert not search._in_the_background(found(grid(square=4.0)), cut)


def test_a_board_may_go_on_beyond_the_picture():
    shape = (200, 260)
    beyond = 22  # the row before the first would be seen that far from the border
    assert not search._open_ended(grid(origin=(beyond + 0.5, 60.0)), shape)
    assert search._open_ended(grid(origin=(beyond - 0.5, 60.0)), shape)
    slanted = grid(origin=(60.0, 60.0)).uv
    slanted[..., 0] -= np.linspace(0, 1, 6)[:, None] * 50  # the lower end of the left side leaves the picture
    out = (slanted[:, 0, 0] - 20 < search.BORDER).mean()
    assert out == 2 / 6
    assert search._open_ended(Lattice(slanted), shape)
    slanted[4, :, 0] += 20
    assert not search._open_ended(Lattice(slanted), shape)


def test_a_half_hidden_row_is_more_than_chance():
    cut = grid(8, 6)
    for extra, more in ((4, False), (5, True)):
        full = grid(9, 6, missing=[9 * r + 8 for r in range(extra, 6)])
        assert search._half_rows(full, cut) == more


@pytest.mark.parametrize("axis", [0, 1])
def test_sparse_rows_at_the_rim_are_cut(axis):
    for number, left in ((4, 7), (3, 6)):
        present = np.ones((7, 8), bool)
        present[0] = np.arange(8) < number
        kept = present[trim(present)] if axis == 0 else present.T[trim(present.T)].T
        assert kept.shape == (left, 8)


def drawn(square=24, removed=14):
    """A picture of a 6x5 board, its corners, and what is known without one of them."""
    h = drawing.homography((6, 5), (120, 100), square=square)
    uv = drawing.corners((6, 5), h)
    gray = drawing.light(h, (6, 5), (240, 200), blur=0.6).astype(np.float32)
    holes = uv.reshape(5, 6, 2).copy()
    holes.reshape(-1, 2)[removed] = np.nan
    return gray, uv, Lattice(holes)


def test_a_missing_corner_lies_within_a_quarter_of_a_square():
    gray, uv, holes = drawn()
    marks = Marks(uv, np.zeros((30, 4, 2)), np.ones(30), 4.0, alternating=True, closed=True)
    for off, number in ((0.22, 30), (0.28, 29)):
        weak = uv[14] + [[off * 24, 0]]
        assert complete(gray, holes, Candidates(marks, weak)).present.sum() == number


def test_a_missing_corner_has_the_contrast_of_the_others():
    gray, uv, holes = drawn()
    marks = Marks(uv, np.zeros((30, 4, 2)), np.ones(30), 4.0, alternating=True, closed=True)
    x, y = np.rint(uv[14]).astype(int)
    mean = gray[y - 9 : y + 10, x - 9 : x + 10].mean()
    for share, number in ((0.45, 30), (0.35, 29)):
        faint = gray.copy()
        faint[y - 9 : y + 10, x - 9 : x + 10] = mean + share * (gray[y - 9 : y + 10, x - 9 : x + 10] - mean)
        assert complete(faint, holes, Candidates(marks, uv[14:15])).present.sum() == number


def test_neighbouring_squares_alternate():
    value = np.where(np.indices((5, 8)).sum(0) % 2 == 0, 200.0, 40.0)
    assert Squares(value).alternation() == 1 and Squares(value).sign == 160
    for part, whole in ((0.3, True), (0.2, False)):
        other = value.copy()
        other[2, 3] = 200 - part * 160  # a black square that is nearly white
        assert (Squares(other).alternation() == 1) == whole
    assert Squares(np.full((5, 8), 7.0)).alternation() == 0


def cross(angle, blur=1.0, contrast=80.0, bend=0.0):
    """A corner of four sectors in the middle of a picture, `angle` wide, one edge bent by `bend`; and its place."""
    y, x = np.mgrid[-20:21:0.25, -20:21:0.25]
    direction = np.arctan2(y, x) % (2 * np.pi)
    edges = np.array([0, angle, np.pi + bend, np.pi + angle])
    sector = np.searchsorted(edges, direction) % 2
    fine = 120 + contrast * (2.0 * sector - 1)
    smooth = np.exp(-(np.arange(-16, 17) ** 2) / (2 * (4 * blur) ** 2))
    smooth /= smooth.sum()
    fine = np.apply_along_axis(np.convolve, 0, fine, smooth, "same")
    fine = np.apply_along_axis(np.convolve, 1, fine, smooth, "same")
    return fine[::4, ::4].astype(np.float32), np.array([[20.0, 20.0]])


def test_sectors_of_a_corner():
    gray, place = cross(1.2)
    index, rays, contrast = candidates._sectors(gray, place, 7.0)
    assert index.tolist() == [0] and contrast == pytest.approx(80, rel=0.03)
    off = (np.sort(rays[0]) - [0, 1.2, np.pi, np.pi + 1.2] + 1) % (2 * np.pi) - 1
    assert np.abs(off).max() < 0.06
    assert len(candidates._sectors(gray, place + 9, 7.0)[0]) == 0  # beside it there are two


@pytest.mark.parametrize(("bend", "seen"), [(0.48, 1), (0.72, 0)])
def test_edges_of_a_corner_are_straight(bend, seen):
    gray, place = cross(1.4, bend=bend)
    assert len(candidates._sectors(gray, place, 7.0)[0]) == seen


def test_candidates_have_contrast_and_are_apart():
    # the blur takes a sixth of it
    least = candidates.LEAST_CONTRAST
    for contrast, number in ((1.22 * least, 1), (0.83 * least, 0)):
        gray, place = cross(1.5, contrast=contrast)
        assert len(candidates._sectors(gray, place, 7.0)[0]) == 1
        assert len(candidates.find_candidates(gray)) == number
    for apart, kept in ((0.95, [False, True]), (1.05, [True, True])):
        pair = np.array([[0.0, 0], [apart * candidates.SINGLE, 0]])
        assert candidates._single(pair, np.array([1.0, 2.0])).tolist() == kept


def outline(a, b, power=2.0):
    """A closed outline of pixels of |x / a|^power + |y / b|^power = 1."""
    t = np.linspace(0, 2 * np.pi, 4000)
    x = a * np.sign(np.cos(t)) * np.abs(np.cos(t)) ** (2 / power)
    y = b * np.sign(np.sin(t)) * np.abs(np.sin(t)) ** (2 / power)
    points = np.rint(np.stack([x, y], -1) + 100).astype(np.int32)
    keep = np.r_[True, (np.diff(points, axis=0) != 0).any(1)]
    return points[keep][:-1, None]


def test_outlines_of_discs():
    assert discs.ellipse_of(outline(12, 12)) is not None
    assert discs.ellipse_of(outline(56, 10)) is not None
    assert discs.ellipse_of(outline(64, 10)) is None
    assert discs.ellipse_of(outline(3.3, 3.3)) is not None
    assert discs.ellipse_of(outline(1.7, 1.7)) is None
    # a square with round corners swings by .046 of its radius, one with sharper ones by .067
    assert discs.ellipse_of(outline(30, 30, power=3.2)) is not None
    assert discs.ellipse_of(outline(30, 30, power=4.5)) is None


def test_discs_are_darker_than_what_is_around_them():
    y, x = np.mgrid[:60, :60]
    inside = np.hypot(x - 30, y - 30) < 12
    disc = discs.Discs(np.array([[30.0, 30.0]]), 12 * np.eye(2)[None])
    for step, dark in ((10, True), (6, False)):
        gray = np.where(inside, 120 - step, 120).astype(np.uint8)
        assert discs._dark_inside(gray, disc)[0] == dark


def test_one_disc_has_one_centre():
    for apart, number in ((0.9, 1), (1.1, 2)):
        centre = np.array([[50.0, 50], [50 + apart * 0.3 * 8, 50]])
        both = discs.Discs(centre, np.stack([10 * np.eye(2), 8 * np.eye(2)]))
        assert len(discs.distinct(both)) == number


def test_unusual_residuals():
    noise = np.r_[np.full(9, 2.0), 2.95, 3.05]
    assert shading.unusual(noise).tolist() == [False] * 10 + [True]


@pytest.mark.parametrize(
    ("gray", "reason"),
    [
        (np.full((100, 100), 29.0), "too-dark"),
        (np.full((100, 100), 241.0), "too-bright"),
    ],
)
def test_dark_and_bright_pictures(gray, reason):
    rng = np.random.default_rng(0)
    assert why_nothing(gray.astype(np.uint8)).reason == reason
    step = 4 if reason == "too-dark" else -4
    noisy = np.clip(gray + step + rng.normal(0, 1, gray.shape), 0, 255)
    assert why_nothing(noisy.astype(np.uint8)).reason != reason


def test_blurred_pictures():
    edge = np.linspace(-1, 1, 200)
    for blur, reason in ((0.1, "too-blurred"), (0.015, "none")):  # of half the picture: 10 px and 1.5 px
        gray = 120 + 100 * np.tanh(edge / blur)[None] * np.ones((200, 1))
        assert why_nothing(gray.astype(np.uint8)).reason == reason


def test_a_fitted_point_that_is_another_corner():
    points = np.stack(np.meshgrid(np.arange(5.0), np.arange(4.0)), -1).reshape(-1, 2)
    assert len(points) > LOCAL_POINTS
    for off, good in ((0.9, True), (1.1, False)):
        known = Known.of(20)
        known.good[:], known.uv[:] = True, 20 * points
        known.uv[7] += [off * 0.5 * 0.4 * 20, 0]
        known.drop_strays(points, 0.4)
        assert known.good[7] == good and known.good.sum() == 19 + good


@pytest.mark.parametrize("margin", [0.3, 0.5, 0.8])
@pytest.mark.parametrize("square", [6, 10, 24])
def test_tight_crops(square, margin):
    """A board that fills a small picture: all corners, though the outer squares are cut."""
    size = (9, 6)
    h = drawing.homography(size, (6.5 * square, 5 * square), square, turn=0.03, tilt=0.2, about=0.5)
    gray, true = drawing.picture(h, size, (13 * square, 10 * square), 2.0, blur=0.6), drawing.corners(size, h)
    low, high = (
        np.floor(true.min(0) - margin * square).astype(int),
        np.ceil(true.max(0) + margin * square).astype(int),
    )
    crop = np.ascontiguousarray(gray[low[1] : high[1] + 1, low[0] : high[0] + 1])
    seen = Checkerboard(*size).find(crop)
    assert len(seen) >= 53
    assert np.linalg.norm(seen.uv + low - true[seen.point_ids], axis=1).max() < 0.05
    free = find_any(crop)
    assert not isinstance(free, Miss) and free[0] == size and not free[1]  # the board may go on


def sight(board, whole):
    return Sight(board=board, whole=whole)


def test_the_size_of_a_board_from_all_pictures():
    part, whole = sight((8, 6), False), sight((9, 6), True)
    for number, size in ((7, (9, 6)), (6, None)):  # of 20 pictures with a checkerboard
        others = [sight((3 + i, 3), False) for i in range(20 - number)]
        answer = decide.board_size([whole] * number + others)
        assert (answer and answer[0]) == size
    for number, agreed in ((12, True), (11, False)):
        others = [sight((3 + i, 3), False) for i in range(20 - number)]
        assert decide.board_size([part] * number + others) == (((8, 6), False, number) if agreed else None)


def test_nonsense_does_not_raise():
    """Grids that fold over, tiles seen through a wild perspective, thousands of crossings of lines."""
    rng = np.random.default_rng(4)
    for seed in range(6):
        tiles = np.full((240, 320), 150, np.float32)
        pitch = 8 + 3 * seed
        tiles[::pitch] = tiles[:, ::pitch] = 60
        h = np.eye(3) + rng.normal(0, 0.15, (3, 3)) * [[1, 1, 100], [1, 1, 100], [0.002, 0.002, 0]]
        gray = cv2.warpPerspective(tiles, h, (320, 240), borderMode=cv2.BORDER_REFLECT)
        gray = np.clip(gray + rng.normal(0, 3, gray.shape), 0, 255).astype(np.uint8)
        assert isinstance(find_any(gray), Miss)
    checks = (np.indices((700, 900)) // 4).sum(0) % 2 * 200 + 20  # 40,000 corners
    find_any(checks.astype(np.uint8))
    folded = grid(6, 5).uv
    folded[2:, :, 1] = folded[2, 0, 1]
    ids, *_ = sharp_corners(checks.astype(np.uint8), Lattice(folded))
    assert len(ids) <= 30


@pytest.mark.parametrize(("times", "whole"), [(0.9 * measure.GROSS, True), (1.1 * measure.GROSS, False)])
def test_a_block_of_tags_with_a_wrong_corner_does_not_decide(times, whole):
    """The misfit of one block counts in full up to GROSS medians of all, and no further."""
    grid, rng = make("aprilgrid:4x4:22mm:0.3"), np.random.default_rng(0)
    ids = np.concatenate([measure._blocks(grid, _all_corners(grid))[0]] * 3)
    image = lambda xy: (xy @ [[20.0, 1.0], [-2.0, 19.0]] + 300) / (1 + 1e-3 * xy[..., :1])  # noqa: E731
    uv = image(grid.points[ids, :2]) + rng.normal(0, 0.05, (*ids.shape, 2))
    cost = lambda uv: homography.solve(grid.points[ids, :2], uv)[2]  # noqa: E731

    def moved(off):
        other = uv.copy()
        other[0, 3, 0] += off
        return cost(other), other

    def beyond(off):
        costs, _ = moved(off)
        return costs[0] - times * np.median(costs)

    costs, other = moved(optimize.brentq(beyond, 0.2, 3))
    found = measure._misfit(grid.spacing, grid, ids, other)
    assert (abs(found / costs.sum() - 1) < 1e-9) == whole


def _all_corners(grid):
    count = len(grid.points)
    return Detection(np.arange(count), grid.points[:, :2].copy(), np.ones(count))
