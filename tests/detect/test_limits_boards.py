"""Limits of candidates, of grids that are fitted and of boards with markers, each just below and just above."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from scipy import optimize

from camcal.detect import (
    board_points,
    candidates,
    disc_fit,
    disc_model,
    grid_fit,
    lattice,
    squares,
)
from camcal.detect.lattice import Lattice
from camcal.detect.recognition import layout, measure
from camcal.detect.targets import checkerboard, tag_board
from camcal.detect.targets.base import Detection
from camcal.geometry import homography
from tests.detect import drawing
from tests.detect.scenes import make
from tests.detect.test_limits_search import checkerboard as checkered
from tests.detect.test_limits_search import places
from tests.sides import LESS, MORE


# ------------------------------------------------------------------------------------ candidates of corners
def test_candidates_that_are_examined():
    for count, number in ((60, candidates.MOST), (45, 44**2)):  # squares along each side
        gray, _ = checkered(6, count)
        noisy = gray + np.random.default_rng(0).normal(0, 0.5, gray.shape).astype(np.float32)
        found = candidates._saddles(cv2.GaussianBlur(noisy, (0, 0), candidates.BLUR))
        assert len(found) == number


@pytest.mark.parametrize(("more", "every"), [(1, 1), (0, 2)])
def test_one_candidate_in_each_neighbourhood(more, every):
    """Of saddles in a row, each stronger than the one before it, the one beside a stronger one is none."""
    apart = candidates.NEIGHBOURHOOD // 2 + more
    v, u = np.mgrid[:61, :61].astype(np.float32)
    smooth = 100 * np.exp(0.002 * (u + v)) * np.sin(np.pi * u / apart) * np.sin(np.pi * v / apart)
    found = np.rint(candidates._saddles(smooth.astype(np.float32)))
    row = [x for x, y in found if 20 <= x < 40]
    assert bool(row) == (every == 1)
    if row:
        assert np.unique(np.diff(np.unique(row))).tolist() == [apart]


def test_the_border_of_the_rings():
    """A candidate needs the innermost ring, and a pixel more, inside the picture."""
    gray, _ = checkered(20, 2)  # one corner, at 19.5 px
    smooth = cv2.GaussianBlur(gray, (0, 0), candidates.BLUR)
    for first, seen in ((19 - candidates.MARGIN, True), (20 - candidates.MARGIN + 1, False)):
        assert (len(candidates._saddles(np.ascontiguousarray(smooth[:, first:]))) == 1) == seen
    assert candidates.MARGIN - 1 <= candidates.RINGS[0] <= candidates.MARGIN


def test_the_smallest_ring(monkeypatch):
    h = drawing.homography((8, 6), (60, 60), square=4.5, turn=0.3)
    gray = drawing.light(h, (8, 6), (120, 120), blur=0.5).astype(np.float32)
    assert len(candidates.find_candidates(gray)) >= 48
    monkeypatch.setattr(candidates, "RINGS", candidates.RINGS[1:])
    assert len(candidates.find_candidates(gray)) < 30


def test_the_largest_ring(monkeypatch):
    """The wider a ring, the more accurate are the directions of the edges."""
    gray, _ = checkered(20, 9)
    noisy = gray + np.random.default_rng(0).normal(0, 10, gray.shape).astype(np.float32)

    def error():
        return np.median(np.abs(candidates.find_candidates(noisy).marks.rays).min(-1))

    wide = error()
    monkeypatch.setattr(candidates, "RINGS", candidates.RINGS[:2])
    assert error() > 1.3 * wide


# ------------------------------------------------------------------------------------ grids of corners
def test_a_homography_of_points_almost_in_a_row():
    """The second row of points lies so little aside that the second singular value is at its limit."""
    points = np.array([[x, y] for y in (0.0, 1.0) for x in range(4)])

    def uv(aside):
        return points * (20.0, 20.0 * aside) + 50

    def gap(aside):
        return float(homography.solve(points[None] * (1, aside), uv(1)[None], steps=1)[1][0])

    assert gap(1.0) > board_points.LEAST_GAP > gap(1e-6)
    aside = optimize.brentq(lambda a: np.log(gap(np.exp(a)) / board_points.LEAST_GAP), np.log(1e-6), 0)
    for share, certain in ((0.9, False), (1.1, True)):
        flat = points * (1, share * np.exp(aside))
        found = board_points.from_points(flat, flat, uv(1))[2]
        assert found.all() == found.any() == certain


@pytest.mark.parametrize(("factor", "first"), [(LESS, False), (MORE, True)])
def test_a_grid_of_a_coarse_picture(monkeypatch, factor, first):
    """Its corners are first fitted there, where the picture is reduced by more than the limit."""
    asked = []
    monkeypatch.setattr(grid_fit, "_fit_reduced", lambda _, lattice: asked.append(1) or lattice)
    gray, uv = checkered(20, 6)
    grid_fit.sharp_corners(gray.astype(np.uint8), Lattice(uv), factor * grid_fit.COARSE, gray)
    assert bool(asked) == first


def test_the_blur_from_which_a_grid_is_fitted(monkeypatch):
    """That of a pixel, what the reduced picture leaves, or what the edges have, whichever is largest."""
    asked = []
    refine = grid_fit.saddle.refine
    monkeypatch.setattr(
        grid_fit.saddle, "refine", lambda *a, blur, **k: asked.append(blur) or refine(*a, blur=blur, **k)
    )
    gray, uv = checkered(20, 6)
    for factor, blur in ((1.0, grid_fit.LEAST_BLUR), (3.0, 3 * grid_fit.ERROR)):
        grid_fit.sharp_corners(gray.astype(np.uint8), Lattice(uv), factor)
        assert asked.pop() == blur
    wide = cv2.GaussianBlur(gray, (0, 0), 2.0)
    grid_fit.sharp_corners(wide.astype(np.uint8), Lattice(uv))
    assert asked.pop() == pytest.approx(2.0, rel=0.1)


def test_good_fits_of_a_grid(monkeypatch):
    count = 20
    least = round(grid_fit.LEAST_GOOD * count)
    for good, again in ((least, count), (least - 1, least - 1)):
        reasons = ("",) * good + ("uncertain",) * (count - good)
        first = SimpleNamespace(good=np.arange(count) < good, reasons=reasons)
        tried = grid_fit._to_be_tried(
            type("C", (SimpleNamespace,), {"__len__": lambda _: count})(**vars(first))
        )
        assert tried.sum() == again
        # and of all corners of a board
        gray, uv = checkered(20, 6)
        whole = SimpleNamespace(picture=gray, lattice=Lattice(places(5, 4)), factor=1.0)
        made = grid_fit.saddle.refine(gray, uv.reshape(-1, 2)[:good], np.tile(20.0 * np.eye(2), (good, 1, 1)))
        monkeypatch.setattr(checkerboard, "oriented", lambda _, lattice, *__: lattice)
        monkeypatch.setattr(checkerboard, "sharp_corners", lambda *_, n=good, m=made: (np.arange(n), m, {}))
        found = checkerboard.detection(gray.astype(np.uint8), whole, 5, 4)
        assert isinstance(found, Detection) == (good == least)


def test_rows_that_are_missing_on_one_side(monkeypatch):
    """A grid is completed by a row at a time."""
    gray, uv = checkered(12, 2 * squares.ROUNDS)
    found = candidates.find_candidates(gray)
    rows = uv.shape[0]
    for missing, left in ((squares.ROUNDS, 0), (squares.ROUNDS + 1, 1)):
        part = uv.copy()
        part[:missing] = np.nan
        made = squares.complete(gray, Lattice(part[missing:]), found)
        assert made.size[1] == rows - left


# ------------------------------------------------------------------------------------ boards with markers
def test_points_of_a_board_that_are_enough(monkeypatch):
    """No finer picture is searched where so many are found."""
    board = make("aprilgrid:6x6:22mm:0.3")
    total = len(board.points)
    least = round(tag_board.ENOUGH * total)
    monkeypatch.setattr(tag_board, "reductions", lambda *_, **__: [4.0, 2.0, 1.0])
    for count, levels in ((least, 1), (least - 1, 3)):
        looked = []
        found = Detection(np.arange(count), np.zeros((count, 2)))
        monkeypatch.setattr(
            type(board), "_at_size", lambda _, __, ___, factor, s=looked, f=found: s.append(factor) or f
        )
        board.find(np.zeros((9, 9), np.uint8), 1e9)
        assert len(looked) == levels


def test_markers_with_which_a_marker_is_compared():
    """A marker that is read at a place of its own is consistent with none; one among others with all around it."""
    board = make("aprilgrid:6x6:1mm:0.3").tag_corners
    image = 50.0 * board + 100
    assert len(tag_board.consistent(board, image)) == 36
    moved = image.copy()
    moved[14] += 60.0
    assert sorted({*range(36)} - set(tag_board.consistent(board, moved).tolist())) == [14]
    # two markers far apart, each among others that are read wrongly, are compared with each other
    for others, kept in ((tag_board.NEIGHBOURS - 1, [0, 1]), (tag_board.NEIGHBOURS, [])):
        row = np.stack([-2.0 * np.arange(1, others + 1), np.zeros(others)], 1)
        at = np.concatenate([[[0, 0], [20, 0]], row, (20, 0) - row])
        on_board = board[0] + at[:, None]
        image = 50.0 * on_board
        image[2:] = image[2:] + 999.0 * np.random.default_rng(0).normal(size=(2 * others, 1, 2))
        assert tag_board.consistent(on_board, image).tolist() == kept


def test_neighbours_of_a_marker_of_a_layout():
    """As many others as are looked at stand nearer than its neighbour."""
    square = 10.0 * (layout.UNIT + 0.5)
    for others, seen in ((layout.NEIGHBOURS - 1, True), (layout.NEIGHBOURS, False)):
        at = [(0.0, 0.0), (100.0, 0.0), *[(20.0 * np.cos(t), 20.0 * np.sin(t)) for t in range(others)]]
        view = [SimpleNamespace(id=i, corners=square + p) for i, p in enumerate(at)]
        near, _ = layout._frames(view)
        assert (1 in near[0]) == seen


def test_the_shortest_distance_of_markers():
    """It is taken where a tenth is shorter, so that a misread one does not count."""
    usual = np.full(100, 2.0)
    for misread, kept in ((layout.SHORTEST - 1, 100 - layout.SHORTEST + 1), (layout.SHORTEST + 1, 0)):
        lengths = usual.copy()
        lengths[:misread] = 1.0
        found = layout._nearest(lengths)
        assert (found == 2.0).sum() == kept


def test_how_often_a_gap_is_measured(monkeypatch):
    target, asked = make("aprilgrid:4x4:22mm:0.3"), []
    count = len(target.points)
    found = Detection(np.arange(count), 20 * target.points[:, :2] + 50)
    monkeypatch.setattr(type(target), "find", lambda self, gray: asked.append(self.spacing) or found)
    made = measure._measured_spacing(measure.grid_with_spacing(target, 0.36), [np.zeros((9, 9))])
    assert made.spacing == 0.3
    # the second search knows what the first has measured
    assert len(asked) == measure.ROUNDS and asked[0] == 0.36 and asked[1] == pytest.approx(0.3, abs=1e-3)


# ------------------------------------------------------------------------------------ discs
def test_the_pixels_of_a_disc():
    """Of a larger band every second one is used; the centre is known as well."""
    v, u = np.mgrid[:300, :300]
    gray = 200 - 150 / (1 + np.exp((np.hypot(u - 150.3, v - 149.6) - 100) / 0.8))

    def band(width):
        made = disc_fit.Discs(np.array([[150.0, 150.0]]), 100.0 * np.eye(2)[None])
        return disc_fit._cut(gray.astype(np.float32), made, width).counts.sum()

    # a ring of radius 100 has 2 pi 100 pixels for each px of its width
    width = disc_fit.MOST_PIXELS / (4 * np.pi * 100)
    assert 0.9 * disc_fit.MOST_PIXELS < band(0.97 * width) <= disc_fit.MOST_PIXELS
    assert 0.45 * disc_fit.MOST_PIXELS < band(1.03 * width) < 0.6 * disc_fit.MOST_PIXELS


@pytest.mark.parametrize(("limit", "inwards"), [(disc_fit.LEAST_BLUR, 1), (disc_fit.MOST_BLUR, -1)])
def test_the_least_and_the_largest_blur_of_a_disc(limit, inwards):
    flat = np.zeros((1, 9))
    band = disc_model.Band(flat, flat, flat, np.ones((1, 9), bool), np.ones(1), 255.0)
    problem = disc_fit._DiscFits(band)
    state = np.ones((1, disc_model.COUNT))
    for off, found in ((inwards * 0.01, limit + inwards * 0.01), (-inwards * 0.01, limit)):
        step = np.zeros_like(state)
        step[:, disc_model.BLUR] = limit + off - 1
        assert problem.retract(state, step)[0, disc_model.BLUR] == pytest.approx(found)


def test_corners_near_a_marker_that_was_read(monkeypatch):
    """So many pitches from it, and from points that are known; farther ones are predicted from those."""
    board = make("aprilgrid:6x6:1mm:0.3")
    asked = []
    nothing = np.zeros(0, int), np.zeros((0, 2)), np.zeros((0, 2, 2))
    monkeypatch.setattr(tag_board, "locate", lambda *a: asked.append(a[-1]) or nothing)
    monkeypatch.setattr(type(board), "_markers", lambda *_: (np.arange(2), np.zeros((2, 4, 2))))
    board.find(np.zeros((99, 99), np.uint8))
    assert asked and set(asked) == {tag_board.REACH * board.pitch}
    known, points = board_points.Known.of(5), np.array([[0.0, 0], [1, 0], [0, 1], [1, 1], [2.0, 0.5]])
    known.good[:4], known.uv[:4] = True, 20 * points[:4]
    far = np.hypot(1.0, 0.5)
    for share, seen in ((LESS, 0), (MORE, 1)):
        assert len(known.neighbours(points, share * far)[0]) == seen


def test_rows_that_are_always_kept():
    """Of a grid of two rows one is not cut off, however sparse it is; of more the sparse one is."""
    for rows in (lattice.LEAST_SIDE, lattice.LEAST_SIDE + 1):
        present = np.ones((rows, 9), bool)
        present[0, 1:] = False
        assert lattice.trim(present)[0] == slice(rows - lattice.LEAST_SIDE, rows)
