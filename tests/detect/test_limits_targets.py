"""Numbers that decide something for one kind of target or window, each just below and just above."""

import struct
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from camcal.detect import corners as fitted_corners
from camcal.detect import edge_model as model
from camcal.detect import exif, local_map, motion_blur, outlines, pyramid, saddle, segment_fit
from camcal.detect.disc_grid import Grid
from camcal.detect.discs import Discs
from camcal.detect.outlines import Squares
from camcal.detect.targets import (
    base,
    checkerboard,
    circles,
    dictionaries,
    outlined,
    squares,
    tag_board,
    tag_grid,
)
from camcal.detect.targets.base import Detection, Miss
from tests.detect.scenes import make
from tests.sides import LESS, MORE

GRAY = np.zeros((400, 600), np.uint8)


def disc_places(columns, rows, axes=(6.0, 6.0)):
    centre = 30.0 * np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), -1).reshape(-1, 2) + 50
    return Discs(centre, np.repeat([np.diag(axes)], len(centre), 0))


def seen_discs(monkeypatch, columns=5, rows=4, axes=(6.0, 6.0), plain=1.0):
    """Whether a grid of discs is taken for a target that was not asked for; a part of them has nothing around."""
    made = disc_places(columns, rows, axes)
    count = columns * rows
    found = Grid(np.arange(count), made, columns, rows, False, 1.0)
    clear = np.arange(count) < round(plain * count)
    monkeypatch.setattr(circles, "search", lambda *_: (found, []))
    monkeypatch.setattr(circles, "_on_plain_ground", lambda *_: (clear, np.full(count, 100.0)))
    monkeypatch.setattr(circles, "_like_discs", lambda *_: True)
    shown = Detection(np.arange(count), made.centre, None, {})
    monkeypatch.setattr(circles.Circles, "find", lambda *_: shown)
    return circles.find_any(GRAY, 1.0) is not None


def test_a_grid_of_discs_that_was_not_asked_for(monkeypatch):
    columns = base.LEAST_UNASKED // 2
    assert seen_discs(monkeypatch, columns, 2) and not seen_discs(monkeypatch, base.LEAST_UNASKED - 1, 1)
    least = round(20 * circles.MOSTLY)
    assert seen_discs(monkeypatch, plain=least / 20) and not seen_discs(monkeypatch, plain=(least - 1) / 20)
    assert seen_discs(monkeypatch, axes=(5 * LESS * circles.LONGISH, 5.0))
    assert not seen_discs(monkeypatch, axes=(5 * MORE * circles.LONGISH, 5.0))


def test_what_the_fits_of_discs_leave():
    """In a picture without noise, of which rounding counts."""
    everywhere = circles.ROUNDING
    for share, like in ((LESS, True), (MORE, False)):
        noise = np.hypot(everywhere, share * circles.UNLIKE * 80)
        found = Detection(np.arange(1), np.zeros((1, 2)), None, {"noise": noise, "contrast": 80.0})
        assert circles._like_discs(GRAY, found) == like


def test_a_disc_where_its_neighbours_do_not_put_it():
    target = make("circles:6x5:20mm")
    for share, stray in ((LESS, False), (MORE, True)):
        centre = 2.0 * target.points[:, :2] + 50
        centre[14] += (0.0, share * circles.STRAY * 40)
        assert target._strays(np.arange(30), centre)[14] == stray


@pytest.mark.parametrize(("count", "found"), [(base.LEAST_UNASKED, True), (base.LEAST_UNASKED - 1, False)])
def test_a_checkerboard_that_was_not_asked_for(monkeypatch, count, found):
    seen = SimpleNamespace(lattice=SimpleNamespace(size=(4, 3)), whole=True)
    monkeypatch.setattr(checkerboard, "search", lambda *_: seen)
    shown = Detection(np.arange(count), np.zeros((count, 2)), None, {})
    monkeypatch.setattr(checkerboard, "detection", lambda *_: shown)
    assert (not isinstance(checkerboard.find_any(GRAY, 1.0), Miss)) == found


def test_the_corners_of_a_checkerboard_that_was_not_asked_for(monkeypatch):
    """Of 40 a part, where that is more than the least number."""
    seen = SimpleNamespace(lattice=SimpleNamespace(size=(8, 5)), whole=True)
    monkeypatch.setattr(checkerboard, "search", lambda *_: seen)
    least = round(40 * checkerboard.SURE)
    for count, found in ((least, True), (least - 1, False)):
        shown = Detection(np.arange(count), np.zeros((count, 2)), None, {})
        monkeypatch.setattr(checkerboard, "detection", lambda *_, s=shown: s)
        assert (not isinstance(checkerboard.find_any(GRAY, 1.0), Miss)) == found


def seen_squares(monkeypatch, columns=5, rows=4, spacing=0.5):
    """The spacing of a grid of squares that is taken for a target that was not asked for."""
    half = 15.0 / (1 + spacing)
    made = disc_places(columns, rows, (half, half))
    count = columns * rows
    found = Grid(np.arange(count), made, columns, rows, False, 1.0)
    monkeypatch.setattr(squares, "search", lambda *_: ((found, np.zeros((count, 4, 2))), []))
    monkeypatch.setattr(squares, "plain_inside", lambda *_: (np.ones(count, bool), np.full(count, 100.0)))
    monkeypatch.setattr(
        squares.SquareGrid, "find", lambda *_: Detection(np.arange(1), np.zeros((1, 2)), None, {})
    )
    answer = squares.find_any(GRAY, 1.0)
    return None if answer is None else answer[1]


def test_a_grid_of_squares_that_was_not_asked_for(monkeypatch):
    assert seen_squares(monkeypatch, base.LEAST_UNASKED // 2, 2) == pytest.approx(0.5)
    assert seen_squares(monkeypatch, base.LEAST_UNASKED - 1, 1) is None
    low, high = base.GAPS
    for spacing in (MORE * low, LESS * high):
        assert seen_squares(monkeypatch, spacing=spacing) == pytest.approx(spacing)
    assert seen_squares(monkeypatch, spacing=LESS * low) is None
    assert seen_squares(monkeypatch, spacing=MORE * high) is None


def test_a_corner_of_a_square_that_is_not_of_the_target():
    target = make("squares:5x4:10mm:0.5")
    count = 20
    for share, kept in ((0.95, True), (1.05, False)):
        corners = (4.0 * target.points[:, :2] + 50).reshape(count, 4, 2)
        corners[9, 2] += (0.0, share * outlined.STRAY * 40)
        fitted = Squares(
            corners, np.zeros((count, 4, 2, 2)), np.ones(count, bool), np.ones(count), np.ones(count)
        )
        keep = outlined.in_place(target.points, target.square, np.arange(count), fitted)
        assert keep[9] == kept and keep[np.arange(count) != 9].all()


def test_markers_where_their_neighbours_expect_them():
    square = 20 * np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    board = np.stack([square, square + (40.0, 0.0)])
    # the second is moved along the line of both, so that each is as far from where the other expects it
    for share, both in ((LESS, [0, 1]), (MORE, [])):
        off = share * tag_board.AGREE / (1 + share * tag_board.AGREE)  # of the expected distance, nearer
        seen = board.copy()
        seen[1] -= (40 * off, 0.0)
        assert tag_board.consistent(board, seen).tolist() == both


def test_the_markers_of_a_grid(monkeypatch):
    target = make("aruco-grid:5x4:10mm:0.5:4X4_50")
    for count, enough in ((tag_grid.LEAST_MARKERS, True), (tag_grid.LEAST_MARKERS - 1, False)):
        tags = np.arange(count)
        corners = 4.0 * target.tag_corners[tags] + 50
        fitted = Squares(
            corners, np.zeros((count, 4, 2, 2)), np.ones(count, bool), np.ones(count), np.ones(count)
        )
        room = []
        monkeypatch.setattr(target, "_markers", lambda *_, t=tags, c=corners: (t, c))
        monkeypatch.setattr(
            outlined,
            "fit_squares",
            lambda g, c, r, b, f=fitted, to=room: to.append(r) or (f, np.full(9, 9.0)),
        )
        monkeypatch.setattr(outlined, "detection", lambda *_: "found")
        assert (target._at_size(GRAY, GRAY, 1.0) == "found") == enough
        if (
            enough
        ):  # profiles reach to the next marker, or a part of the border's width beyond the bits behind it
            assert room == [min(target.spacing, tag_grid.FARTHER * target._border_share)]


def test_the_smallest_marker_that_is_looked_for():
    both = dictionaries.LEAST_PERIMETER / dictionaries.LEAST_RATE  # px, where the two limits meet

    def least(longest):
        return dictionaries.detector("4X4_50", 1, longest).getDetectorParameters().minMarkerPerimeterRate

    assert least(round(both / 2)) == pytest.approx(2 * dictionaries.LEAST_RATE, rel=1e-3)
    assert least(round(2 * both)) == pytest.approx(dictionaries.LEAST_RATE)


def test_the_profiles_of_a_side():
    """Sides with room for just so many profiles between the ends that are left out."""
    y = np.arange(60.0)[:, None].repeat(60, 1)
    gray = np.where(y < 30, 220.0, 40.0).astype(np.float32)
    gray = cv2.GaussianBlur(gray, (0, 0), 0.8)
    room = outlines.SPACING * (outlines.LEAST_PROFILES - 1)
    for length, fits in ((5.0 + room + 0.01, True), (5.0 + room - 0.01, False)):
        edge = outlines._edge(
            gray,
            np.array([20.0, 29.5]),
            np.array([20.0 + length, 29.5]),
            3.0,
            np.full(2, outlines.ENDS_PX),
            0.0,
        )
        assert (edge is not None) == fits


def test_a_square_without_room_for_profiles():
    gray = np.full((80, 80), 220, np.uint8)
    gray[20:60, 20:60] = 40
    gray = cv2.GaussianBlur(gray, (0, 0), 0.7)
    quad = np.array([[[19.5, 19.5], [59.5, 19.5], [59.5, 59.5], [19.5, 59.5]]])
    for share, good in ((LESS, False), (MORE, True)):
        room = np.array([share * outlines.SHORTEST / outlines.REACH])
        assert outlines.refine_squares(gray, quad, room).good[0] == good


# ------------------------------------------------------------------------------------ windows of corners
def known_corners(blur):
    params = np.zeros((1, model.COUNT))
    params[:, model.BLUR] = blur
    return fitted_corners.Corners(np.zeros((1, 2)), np.eye(2)[None], params, np.ones(1), ("",))


def test_a_window_keeps_clear_of_the_next_edge():
    side = 20.0
    sides = side * np.eye(2)[None]
    widest = (1 - saddle.INNER_HALF) * side / saddle.CLEAR  # px of blur
    narrowest = (1 - saddle.LEAST_HALF) * side / saddle.CLEAR

    def share(blur):
        return saddle.shares(known_corners(blur), sides, saddle.INNER_HALF)[0]

    assert share(LESS * widest) == saddle.INNER_HALF > share(MORE * widest)
    assert share(LESS * narrowest) > saddle.LEAST_HALF == share(MORE * narrowest)


def test_the_windows_of_corners_at_the_rim():
    half = saddle.wider_halves(5, 4, saddle.INNER_HALF).reshape(4, 5)
    rim = np.ones((4, 5), bool)
    rim[1:-1, 1:-1] = False
    assert (half[rim] == saddle.WIDER_HALF).all() and (half[~rim] == saddle.INNER_HALF).all()
    assert (saddle.wider_halves(5, 4, LESS * saddle.WIDER_HALF) == LESS * saddle.WIDER_HALF).all()


def windows_of(monkeypatch, square, blur=saddle.START_BLUR):
    """Half-widths, of the square and of the largest window, px, that a first fit asks for; and its first blur."""
    asked = []

    def cut(gray, uv, sides, half, reach, largest):
        asked.append((float(np.ravel(half)[0]), float(np.ravel(reach)[0]), float(largest)))
        raise StopIteration

    monkeypatch.setattr(saddle, "cut", cut)
    with pytest.raises(StopIteration):
        saddle.refine(GRAY, np.array([[50.0, 50]]), square * np.eye(2)[None], blur=blur)
    return asked[0]


def test_the_windows_of_small_squares(monkeypatch):
    """Between two sizes of squares they have the same size in px."""
    small, large = saddle.LEAST_PX / saddle.WIDER_HALF, saddle.LEAST_PX / saddle.HALF
    assert windows_of(monkeypatch, LESS * small)[0] == saddle.WIDER_HALF
    assert windows_of(monkeypatch, MORE * small)[0] * MORE * small == pytest.approx(saddle.LEAST_PX)
    assert windows_of(monkeypatch, LESS * large)[0] * LESS * large == pytest.approx(saddle.LEAST_PX)
    assert windows_of(monkeypatch, MORE * large)[0] == saddle.HALF


def test_the_windows_of_blurred_corners(monkeypatch):
    limit = saddle.FIRST_LARGEST / saddle.FIRST_SEEN
    assert windows_of(monkeypatch, 60.0, LESS * limit)[2] == saddle.FIRST_LARGEST
    assert windows_of(monkeypatch, 60.0, MORE * limit)[2] == pytest.approx(MORE * saddle.FIRST_LARGEST)
    # one more blur is so many more px from the edges
    reach = [windows_of(monkeypatch, 60.0, blur)[1] for blur in (1.0, 2.0)]
    assert np.diff(reach) == pytest.approx(saddle.SEEN)


def test_the_first_blur_of_a_small_square(monkeypatch):
    asked = []

    def guess(windows, normals, blur):
        asked.append(float(blur[0]))
        raise StopIteration

    monkeypatch.setattr(saddle, "first_guess", guess)
    limit = saddle.START_BLUR / saddle.MOST_START
    for share, blur in ((0.9, 0.9 * saddle.START_BLUR), (1.1, saddle.START_BLUR)):
        with pytest.raises(StopIteration):
            saddle.refine(GRAY, np.array([[50.0, 50]]), share * limit * np.eye(2)[None])
        assert asked[-1] == pytest.approx(blur)


def test_a_perspective_that_is_too_strong():
    """The depth grows from 1 to a ratio over the board: beyond the limit an affinity takes its place."""
    board = np.stack(np.meshgrid(np.arange(6.0), np.arange(5.0)), -1).reshape(-1, 2)
    for share, exact in ((0.99, True), (1.01, False)):
        ratio = share * local_map.STEEPEST
        depth = 1 + (ratio - 1) * board[:, 0] / 5
        uv = 100 * board / depth[:, None] + 50
        assert np.allclose(local_map._perspective(uv, board)(uv), board, atol=1e-6) == exact


def test_the_block_of_a_map():
    """A corner beyond the block of six has no part in the map of another one."""
    uv = 20.0 * np.stack(np.meshgrid(np.arange(9.0), np.arange(9.0)), -1) + 100
    wide = local_map.SPAN // 2

    def moved(column):
        other = uv.copy()
        other[4, column] += (0.0, 2.0)
        near = [
            local_map._polynomials(x / 20, uv / 20, np.ones((9, 9), bool))[1][4 * 9 + 4] for x in (uv, other)
        ]
        return np.abs(near[0] - near[1]).max() > 1e-6

    assert moved(4 - wide) and not moved(4 + wide) and not moved(4 - wide - 1)


def test_a_blur_that_is_narrow_in_one_direction():
    """Variances 1 + d and 1 - d: the narrow one is no less than a part of the mean."""
    for share in (LESS, MORE):
        narrow = share * motion_blur.LEAST_VARIANCE
        variances = np.array([2 - narrow, narrow])
        angle = np.array([0.0, np.pi / 2, np.pi / 4])
        n = np.stack([np.cos(angle), np.sin(angle)], -1)
        products = (n**2 * variances).sum(1)[None]
        ratio, _ = motion_blur.blur_ellipse(np.stack([angle, angle], -1)[None], products)
        floor = max(narrow, motion_blur.LEAST_VARIANCE)
        assert ratio == pytest.approx(np.sqrt((2 - narrow) / floor))


# ------------------------------------------------------------------------------------ pictures
def test_the_size_of_the_first_search():
    side = int(np.sqrt(pyramid.FIRST_PIXELS))
    assert pyramid.reductions((side, side), True) == [1.0, 0.5]
    assert pyramid.reductions((side + 1, side + 1), True) == [2.0, 1.0]


def test_the_outliers_of_a_range():
    """Of 100,000 pixels of 16 bits: dead ones do not count up to a thousandth."""
    most = round(1000 * pyramid.OUTLIERS)
    for dead, high in ((most - 5, 2000.0), (most + 5, 60000.0)):
        gray = np.full((250, 400), 2000, np.uint16)
        gray[:, :200] = 1000
        gray.ravel()[:dead] = 60000
        assert pyramid.grey_range(gray) == (1000.0, high)


def test_a_segment_beside_its_edge():
    """The line of an edge is found within the reach of the segment, and its own ends are left out."""
    gray = np.where(np.arange(80)[:, None] < 40, 30.0, 220.0).repeat(120, 1)
    for off, found in ((segment_fit.REACH - 0.5, True), (segment_fit.REACH + 0.5, False)):
        ends = np.array([[[20.0, 39.5 + off], [100.0, 39.5 + off]]])
        moved = segment_fit.refined(gray, ends)
        assert (np.abs(moved[0, :, 1] - 39.5).max() < 0.05) == found
    least = segment_fit.LEAST + 2 * segment_fit.TRIM
    for length, found in ((least - 0.5, True), (least - 1.5, False)):
        ends = np.array([[[20.0, 40.0], [20 + length, 40.0]]])
        assert (segment_fit.refined(gray, ends)[0] != ends[0]).any() == found


# ------------------------------------------------------------------------------------ EXIF
def jpeg(entries):
    """A JPEG header with so many EXIF entries (tag, type, count, value of 4 bytes or a text)."""
    texts, rows, at = b"", b"", 8 + 2 + 12 * len(entries) + 4
    for tag, kind, value in entries:
        if isinstance(value, bytes):
            rows += struct.pack("<HHII", tag, kind, len(value), at + len(texts))
            texts += value
        else:
            rows += struct.pack("<HHIHH", tag, kind, 1, value, 0)
    tiff = b"II*\0" + struct.pack("<IH", 8, len(entries)) + rows + bytes(4) + texts
    return b"\xff\xd8\xff\xe1" + struct.pack(">H", len(tiff) + 8) + b"Exif\0\0" + tiff


def test_values_of_exif():
    most = exif.ORIENTATIONS
    for value, read in ((1, 1), (most, most), (most + 1, 1), (0, 1)):
        assert exif.read_exif(jpeg([(exif.ORIENTATION, 3, value)])).orientation == read
    longest = exif.LONGEST_TEXT
    for length in (longest, longest + 1):
        assert exif.read_exif(jpeg([(exif.MODEL, 2, b"x" * length)])).camera == "x" * longest
    for before, read in ((exif.MOST_ENTRIES - 1, 6), (exif.MOST_ENTRIES, 1)):
        assert exif.read_exif(jpeg([(1, 3, 0)] * before + [(exif.ORIENTATION, 3, 6)])).orientation == read
