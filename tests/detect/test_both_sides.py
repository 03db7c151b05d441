"""Numbers that decide something in the search for targets and lines, each just below and just above."""

import struct
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from camcal.detect import (
    board_points,
    exif,
    films,
    frames,
    headers,
    images,
    lattice,
    line_points,
    lines,
    local_map,
    outlines,
    view_information,
)
from camcal.detect.board_points import strays
from camcal.detect.exif import UNKNOWN, Taken
from camcal.detect.films import Shown
from camcal.detect.recognition import layout, measure
from camcal.detect.recognition.layout import Patch
from camcal.detect.targets import base
from camcal.detect.targets.base import Detection
from camcal.detect.targets.printing import sheet
from camcal.errors import UsageError
from tests.detect.scenes import make
from tests.sides import LESS, MORE


# ------------------------------------------------------------------------------------ targets
def test_the_time_of_the_next_picture():
    assert base.time_for_next(1.0, base.LARGER)
    assert not base.time_for_next(1.0, LESS * base.LARGER)


@pytest.mark.parametrize("spec", ["squares:4x3:10mm:{:g}", "aruco-grid:4x3:10mm:{:g}:4X4_50"])
def test_the_largest_gap(spec):
    assert make(spec.format(base.MOST_GAP)).spacing == base.MOST_GAP
    for gap in (base.MOST_GAP * MORE, 0.0):
        with pytest.raises(UsageError, match="is out of range"):
            make(spec.format(gap))


def test_a_sheet_of_the_size_of_its_page():
    assert sheet._fits((210.0 + 0.5 * sheet.ROUNDING, 297.0), (210.0, 297.0))
    assert not sheet._fits((210.0, 297.0 + 2 * sheet.ROUNDING), (210.0, 297.0))


def test_a_ruler_ends_at_a_tick():
    assert sheet._ruler_length(3 * sheet.TICK) == 3 * sheet.TICK
    assert sheet._ruler_length(LESS * 3 * sheet.TICK) == 2 * sheet.TICK
    assert sheet._ruler_length(sheet.LONGEST_RULER + sheet.TICK) == sheet.LONGEST_RULER


# ------------------------------------------------------------------------------------ corners
def board(square):
    """Points of a board of 6 x 5 in squares, and their images, so many px apart."""
    points = np.stack(np.meshgrid(np.arange(6.0), np.arange(5.0)), -1).reshape(-1, 2)
    return points, square * points + 50.0


@pytest.mark.parametrize(
    ("square", "room", "limit"),
    [(20.0, 0.5, 10.0), (20.0, 0.2, 4.0), (2.0, 0.5, board_points.LEAST_ROOM)],
)
def test_a_point_away_from_where_its_neighbours_predict_it(square, room, limit):
    points, uv = board(square)
    for off, stray in ((LESS * limit, False), (MORE * limit, True)):
        moved = uv.copy()
        moved[14] += (0.0, off)
        # the others' predictions are off by it as well, but by less
        assert strays(points, moved, room)[14] == stray


def test_the_corners_of_a_polynomial():
    for number, side, terms in (
        (local_map.FOR_CUBIC, 4, local_map.CUBIC),
        (local_map.FOR_CUBIC - 1, 4, local_map.QUADRATIC),
        (local_map.FOR_CUBIC, 3, local_map.QUADRATIC),
        (local_map.FOR_QUADRATIC, 3, local_map.QUADRATIC),
        (local_map.FOR_QUADRATIC - 1, 3, local_map.LINEAR),
        (local_map.FOR_QUADRATIC, 2, local_map.LINEAR),
    ):
        assert local_map._terms(np.array([number]), side) == [terms]


def test_a_sparse_outer_row():
    present = np.ones((5, 10), bool)
    present[0, int(10 * lattice.SPARSE) :] = False
    assert lattice.trim(present) == (slice(0, 5), slice(0, 10))
    present[0, int(10 * lattice.SPARSE) - 1] = False
    assert lattice.trim(present) == (slice(1, 5), slice(0, 10))


def test_points_that_say_something_of_a_camera():
    points = np.array([[0, 0], [3, 0], [0, 2], [3, 2], [1, 1], [2, 1]], float)
    h = np.array([[40.0, 3, 100], [2, 45, 80], [0.01, 0.02, 1]])
    q = np.c_[points, np.ones(len(points))] @ h.T
    uv = q[:, :2] / q[:, 2:]
    count = view_information.LEAST_POINTS
    assert view_information.information(points[:count], uv[:count], 0.1, (640, 480)).any()
    assert not view_information.information(points[: count - 1], uv[: count - 1], 0.1, (640, 480)).any()


# ------------------------------------------------------------------------------------ outlines
def outline(corners):
    return np.array(corners, np.int32)[:, None]


def test_the_smallest_square():
    side = int(outlines.LEAST_SIDE)
    assert outlines._quadrilateral(outline([[0, 0], [side, 0], [side, side], [0, side]])) is not None
    assert outlines._quadrilateral(outline([[0, 0], [side, 0], [side, side - 1], [0, side - 1]])) is None
    # long enough around, too short on one side
    assert outlines._quadrilateral(outline([[0, 0], [50, 0], [50, side - 1], [0, side - 1]])) is None


def test_the_sharpest_corner_of_a_square():
    """A rhombus of sides of 1,000 px, so that whole pixels hardly change the angle."""
    for cosine, kept in ((outlines.MOST_ANGLE - 0.005, True), (outlines.MOST_ANGLE + 0.005, False)):
        x, y = 1000 * cosine, 1000 * np.sqrt(1 - cosine**2)
        found = outlines._quadrilateral(outline(np.rint([[0, 0], [1000, 0], [1000 + x, y], [x, y]])))
        assert (found is not None) == kept


# ------------------------------------------------------------------------------------ recognition
def test_enough_markers_for_a_layout():
    least, share = layout.LEAST_EXPLAINED, layout.LEAST_AGREEING
    assert layout._enough(least, least) and not layout._enough(least - 1, least - 1)
    assert layout._enough(round(100 * share), 100) and not layout._enough(round(100 * share) - 1, 100)


@pytest.mark.parametrize("diagonal", [True, False])
def test_neighbours_of_a_marker(diagonal):
    """Steps to single neighbours, of which one is at the limit of a step's length or direction."""
    along = (1.0, 1.0) if diagonal else (1.0, 0.0)
    usual = [2 * np.array(along)] * 4

    def counted(last):
        return len(layout._steps(np.array([*usual, last]), diagonal)) == len(usual) + 1

    for size in (layout.SINGLE * 2,):
        assert counted(LESS * size * np.array(along)) and not counted(MORE * size * np.array(along))
    limit = layout.DIAGONAL if diagonal else layout.STRAIGHT
    inside, outside = (MORE, LESS) if diagonal else (LESS, MORE)
    assert counted(np.array([2.0, 2.0 * limit * inside]))
    assert not counted(np.array([2.0, 2.0 * limit * outside]))


@pytest.mark.parametrize("diagonal", [True, False])
def test_the_farthest_neighbour_of_a_marker(diagonal):
    along = np.array((1.0, 1.0) if diagonal else (1.0, 0.0))
    assert len(layout._steps(np.array([LESS * layout.FARTHEST * along]), diagonal)) == 1
    assert not len(layout._steps(np.array([MORE * layout.FARTHEST * along]), diagonal))


def test_a_neighbour_at_a_whole_step():
    near = np.array([[1], [0]])
    for miss, groups in ((LESS * layout.EVEN, 1), (MORE * layout.EVEN, 2)):
        offset = np.array([[[1.0 + miss, 0.0]], [[-1.0 - miss, 0.0]]])
        assert len(list(layout._walk(near, offset, False))) == groups


def test_the_steps_of_a_layout():
    """Two markers make two distances, of which one is not enough; a third makes more."""

    def views(count):
        square = 40.0 * (layout.UNIT + 0.5)
        return [[SimpleNamespace(id=i, corners=square + (60.0 * i, 0.0)) for i in range(count)]]

    assert layout._patches(views(2), False) == ([], 0.0)
    patches, step = layout._patches(views(3), False)
    assert patches == [Patch(0, {0: (0, 0), 1: (1, 0), 2: (2, 0)})] and step == pytest.approx(1.5)


@pytest.mark.parametrize(
    ("step", "near"),
    [(measure.MARKER_STEP, measure.MARKER_NEAR), (measure.GAP_STEP, measure.GAP_NEAR)],
)
def test_a_value_that_people_choose(step, near):
    assert measure.rounded(0.5 + LESS * near, step, near) == 0.5
    assert measure.rounded(0.5 + near + 0.0006, step, near) == pytest.approx(0.5 + near + 0.0006, abs=5e-4)
    assert measure.rounded(0.5 + near + 0.0006, step, near) != 0.5


def test_the_gap_that_a_layout_begins_with():
    """Markers in rows far apart; of Kalibr's grids the gap is at most what one of them may have."""
    for gap in (0.25, 1.9, 3.0):
        places = [(i % 4, i // 4) for i in range(12)]
        square = 20.0 * (layout.UNIT + 0.5)
        view = [
            SimpleNamespace(id=i, corners=square + 20.0 * (1 + gap) * np.array(p))
            for i, p in enumerate(places)
        ]
        found = layout.find_boards([view], ("4X4_1000", 1))[0].board
        assert (found.kind, found.columns, found.rows) == ("aruco-grid", 4, 3)
        assert found.spacing == pytest.approx(gap, abs=1e-6)
        again = [  # ids from the lower left, as a grid of Kalibr's has them; its tags are turned by 180 degrees
            SimpleNamespace(id=i, corners=square[[2, 3, 0, 1]] + 20.0 * (1 + gap) * np.array((x, 2 - y)))
            for i, (x, y) in enumerate(places)
        ]
        found = layout.find_boards([again], ("APRILTAG_36h11", 2))[0].board
        assert found.kind == "aprilgrid"
        assert found.spacing == pytest.approx(min(gap, layout.LARGEST_GAP), abs=1e-6)


# ------------------------------------------------------------------------------------ lines
def straight(start, end, count=60):
    return np.linspace(start, end, count)


def test_two_parts_of_one_line():
    a = straight((0, 0), (100, 0))
    for cosine, one in ((lines.BENT + 0.002, True), (lines.BENT - 0.002, False)):
        turn = np.arccos(cosine)
        step = np.array([np.cos(turn), np.sin(turn)])
        # the second begins so that the line between the midpoints has the direction of the first
        b = np.array([200.0, 0.0]) + np.linspace(-50, 50, 60)[:, None] * step
        assert lines._lead_on(a, b) == one


def test_the_gap_between_two_parts_of_a_line():
    a = straight((0, 0), (100, 0))
    for gap, one in ((LESS * lines.LARGEST_GAP * 50, True), (MORE * lines.LARGEST_GAP * 50, False)):
        b = straight((100 + gap, 0), (150 + gap, 0))
        assert (lines._joint((a, 0.01), (b, 0.01)) is not None) == one


def test_a_line_beside_another_is_another():
    a = straight((0, 0), (100, 0))
    for part in (1.0, lines.WHOLE + 0.005):  # of both lengths together
        b = straight((100 - (1 - part) * 200, 0), (200 - (1 - part) * 200, 0))
        assert lines._joint((a, 0.01), (b, 0.01)) is not None
    b = straight((100 - (1.005 - lines.WHOLE) * 200, 0), (200 - (1.005 - lines.WHOLE) * 200, 0))
    assert lines._joint((a, 0.01), (b, 0.01)) is None


def test_a_run_of_points():
    count = lines.LEAST_IN_RUN
    uv = np.c_[
        np.r_[np.linspace(0, lines.RUN - 1, count), lines.RUN + np.arange(count - 1)], np.zeros(2 * count - 1)
    ]
    assert len(lines._averaged(uv)) == 1  # the second run lacks a point
    uv = np.r_[uv, [[lines.RUN + count, 0.0]]]
    assert len(lines._averaged(uv)) == 2


def test_a_point_far_from_its_line():
    x = np.linspace(0, 200, 101)
    y = 0.1 * np.where(np.arange(101) % 2, 1.0, -1.0)  # the median of |y| is .1
    sigma = 0.1 / 0.6745
    for off, kept in ((0.9 * lines.FAR * sigma, 101), (1.2 * lines.FAR * sigma, 100)):
        other = y.copy()
        other[50] = off
        found = lines._smooth(np.c_[x, other])
        assert found is not None and len(found[0]) == kept


def test_the_roughest_line():
    x = np.linspace(0, 400, 401)
    sign = np.where(np.arange(401) % 2, 1.0, -1.0)
    for sigma, kept in ((0.98 * lines.ROUGHEST, True), (1.02 * lines.ROUGHEST, False)):
        assert (lines._smooth(np.c_[x, 0.6745 * sigma * sign]) is not None) == kept


def test_a_weak_point_of_a_line():
    uv = np.zeros((100, 2))
    for share, kept in ((MORE, 100), (LESS, 99)):
        response = np.ones(100)
        response[0] = share * line_points.WEAKEST
        assert len(line_points._strong(uv, uv, response).uv) == kept
    # the strong ones count, and not a few that are stronger still
    response = np.where(np.arange(100) < 100 * (1 - line_points.STRONG) - 1, 1e6, 1.0)
    assert len(line_points._strong(uv, uv, response).uv) == 100


# ------------------------------------------------------------------------------------ files, films
@pytest.mark.parametrize(
    ("rate", "count", "known"),
    [
        (frames.FASTEST * LESS, frames.MOST_FRAMES - 1, True),
        (frames.FASTEST, frames.MOST_FRAMES, False),
        (0.0, 0, False),
    ],
)
def test_what_a_film_says_of_itself(monkeypatch, rate, count, known):
    said = {cv2.CAP_PROP_FPS: rate, cv2.CAP_PROP_FRAME_COUNT: count}
    monkeypatch.setattr(frames, "_opened", lambda path: SimpleNamespace(get=said.get))
    film = frames.Film(Path("film.mp4"))
    assert (film.rate > 0, film.count > 0) == (known, known)


def test_numbers_of_exif():
    assert exif._number(LESS * exif.LARGEST) > 0 and exif._number(exif.LARGEST) == 0
    assert exif._number(0) == 0 and exif._number(-1) == 0 and exif._number("35") == 0


@pytest.mark.parametrize(("share", "other"), [(LESS, False), (MORE, True)])
def test_another_focal_length(share, other):
    taken = Taken("X", 35.0 * (1 + share * images.SAME_FOCAL), 1.0, 1)
    assert images._other_camera(taken, Taken("X", 35.0, 1.0, 1)) == other
    assert not images._other_camera(UNKNOWN, Taken("X", 35.0, 1.0, 1))


def tiff(entries):
    """A TIFF directory: so many entries without a meaning, then width and height."""
    rows = [(1, 3, 0)] * entries + [(256, 3, 640), (257, 3, 480)]
    body = b"".join(struct.pack("<HHIHH", tag, kind, 1, value, 0) for tag, kind, value in rows)
    return b"II*\0" + struct.pack("<IH", 8, len(rows)) + body


def test_the_entries_of_a_directory():
    assert headers._tiff(tiff(headers.MOST_ENTRIES - 2)) == (640, 480)
    assert headers._tiff(tiff(headers.MOST_ENTRIES - 1)) is None


def test_boxes_inside_each_other():
    def box(kind, body):
        return struct.pack(">I4s", 8 + len(body), kind) + body

    def nested(depth):
        data = box(b"ispe", struct.pack(">III", 0, 640, 480))
        for _ in range(depth):
            data = box(b"iprp", data)
        return data

    for depth, found in ((headers.DEEPEST, (640, 480)), (headers.DEEPEST + 1, None)):
        data = nested(depth)
        assert headers._boxes(data, 0, len(data), 0) == found


def shown(uv, blur=0.6, motion=0.0):
    points = np.stack(np.meshgrid(np.arange(4.0), np.arange(3.0)), -1).reshape(-1, 2)
    found = Detection(np.arange(12), uv, np.full(12, 0.1), {"blur_px": blur})
    return Shown("f", points, found, (600, 800), motion)


def grid_at(shift=0.0):
    return 60.0 * np.stack(np.meshgrid(np.arange(4.0), np.arange(3.0)), -1).reshape(-1, 2) + (
        200.0 + shift,
        150.0,
    )


def test_a_target_that_moved():
    limit = films.MOVED * 1000.0  # px of a picture of 600 x 800
    assert films._same_pose(shown(grid_at()), shown(grid_at(LESS * limit)))
    assert not films._same_pose(shown(grid_at()), shown(grid_at(MORE * limit)))


@pytest.mark.parametrize("sharp", [1.0, films.LEAST_BLUR / films.BLURRED / 2])
def test_a_blurred_frame(sharp):
    """Beyond so many times the blur of the sharper frames, and where that is more than an edge of a pixel."""
    limit = max(films.BLURRED * sharp, films.LEAST_BLUR)
    for blur, left in ((LESS * limit, False), (MORE * limit, True)):
        film = [shown(grid_at(30.0 * k), sharp) for k in range(5)] + [shown(grid_at(200.0), blur)]
        reasons = films.left_out(film, 10)
        assert reasons.get(5, "").startswith("blurred") == left


def test_a_point_in_a_row_of_points():
    """The second singular value of a homography's equations: points in a line determine none."""
    points = np.stack([np.arange(12.0), np.zeros(12)], 1)
    _, _, certain = board_points.from_points(points, points, 20 * points + 5, leave_out=True)
    assert not certain.any()
    full, uv = board(20.0)
    assert board_points.from_points(full, full, uv, leave_out=True)[2].all()
