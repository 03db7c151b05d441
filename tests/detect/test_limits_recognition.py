"""Numbers that decide which target pictures show, each just below and just above."""

from types import SimpleNamespace

import numpy as np
import pytest

from camcal.detect import marked_grid, several, unasked
from camcal.detect.recognition import decide, families, layout, marks, measure, quads
from camcal.detect.recognition.decide import Answer
from camcal.detect.recognition.families import Marker
from camcal.detect.recognition.layout import Patch
from camcal.detect.recognition.look import Sight
from camcal.detect.targets import base, dictionaries
from camcal.detect.targets.base import Detection
from tests.detect.scenes import make
from tests.sides import LESS, MORE


# ------------------------------------------------------------------------------------ all pictures together
def test_pictures_that_show_the_whole_board():
    """Of a hundred; the others show parts of it, of different sizes."""
    least = round(100 * decide.LEAST_VOTES)
    for whole, size in ((least, (9, 6)), (least - 1, None)):
        parts = [Sight(board=(3 + i, 3)) for i in range(100 - whole)]
        found = decide.board_size([Sight(board=(9, 6), whole=True)] * whole + parts)
        assert found == (None if size is None else (size, True, whole))


def test_pictures_that_show_the_same_part_of_a_board():
    least = round(100 * decide.AGREEING)
    for same, found in ((least, ((8, 5), False, least)), (least - 1, None)):
        parts = [Sight(board=(3 + i, 3)) for i in range(100 - same)]
        assert decide.board_size([Sight(board=(8, 5))] * same + parts) == found


def test_proportions_that_differ_from_the_requested_ones(monkeypatch):
    """A board is measured where its outlines differ, and is another one where the measured size differs."""
    requested = make("charuco:9x7:1mm:0.5mm:4X4_100")
    asked = []

    def of(rough, close):
        shown = [measure.board_with_marker(requested, 0.5 * (1 + share)) for share in (rough, close)]
        monkeypatch.setattr(decide, "_boards", lambda _: [layout.Found(shown[0], (0,), 9)])
        monkeypatch.setattr(decide, "explains", lambda *_: 1.0)
        monkeypatch.setattr(decide, "measured", lambda *_: asked.append(1) or shown[1])
        asked.clear()
        other = decide.contradiction(requested, [Sight()], [None])
        return len(asked), other is None

    assert of(LESS * decide.ROUGHLY, 0.9) == (0, True)
    assert of(MORE * decide.ROUGHLY, LESS * decide.CLOSELY) == (1, True)
    assert of(MORE * decide.ROUGHLY, MORE * decide.CLOSELY) == (1, False)


def drawn(count, side=48):
    """A white picture with so many markers of 4x4 cells, in a row."""
    gray = np.full((2 * side, 2 * side * count), 255, np.uint8)
    for i in range(count):
        cells = 255 * ~dictionaries.black_cells("4X4_50", i)
        marker = np.kron(cells, np.ones((side // 6, side // 6))).astype(np.uint8)
        gray[side // 2 : side // 2 + side, 2 * side * i + side // 2 : 2 * side * i + side // 2 + side] = (
            marker
        )
    return gray


def test_markers_that_are_more_than_clutter():
    least = families.LEAST_MARKERS
    family, found = families.read_markers(drawn(least))
    assert family == ("4X4_1000", 1) and {m.id for m in found} == set(range(least))
    assert families.read_markers(drawn(least - 1)) == (None, [])
    both = np.concatenate([drawn(least), drawn(least)])  # read of another family, all of it is left
    assert len(families.read_others(both, ("5X5_1000", 1), [])[0][1]) == 2 * least
    assert families.read_others(drawn(least - 1), ("5X5_1000", 1), []) == ()


def test_squares_whose_markers_are_not_read():
    for count, unread in ((families.LEAST_MARKERS - 1, 1), (families.LEAST_MARKERS, 0)):
        markers = tuple(Marker(i, np.zeros((4, 2))) for i in range(count))
        assert decide.unread([Sight(marked=True, markers=markers)], None) == unread


def test_pictures_of_a_further_board():
    best = Answer(make("charuco:9x7:40mm:20mm:4X4_100"), (0, 1, 2, 3))
    other = make("charuco:5x8:30mm:22mm:APRILTAG_36h11")
    least = several.LEAST_PICTURES
    for count, taken in ((least, 1), (least - 1, 0)):
        assert len(several.further(best, [best, Answer(other, tuple(range(count)))])) == taken


def test_corners_that_two_boards_share():
    uv = 20.0 * np.stack(np.meshgrid(np.arange(4.0), np.arange(3.0)), -1).reshape(-1, 2)
    for off, boards in ((LESS * several.SAME_CORNER, [0]), (MORE * several.SAME_CORNER, [0, 1])):
        assert several._apart([uv, uv[:6] + (off, 0.0)]) == boards


def test_pictures_that_agree_on_a_plain_board():
    plain = Sight(board=(9, 6), whole=True)
    assert unasked._agreed([plain] * unasked.AGREEING) == (9, 6)
    assert unasked._agreed([plain] * (unasked.AGREEING - 1)) is None
    assert unasked._agreed([plain] * (unasked.AGREEING - 1) + [Sight(board=(8, 6), whole=True)]) is None


# ------------------------------------------------------------------------------------ marks in squares
SQUARE = 60


def marked(spread=0.0, other=0.0, rim=0.0, squares=6):
    """A board of white and black squares (150 apart), of which the white have two halves that differ.

    `spread` and `other` are the standard deviations in white and in black squares, grey levels; `rim` is the width
    of a black strip at the upper side of the white ones, of a square.
    """
    gray = np.zeros((SQUARE * squares, SQUARE * squares), np.float32)
    half = np.where(np.arange(SQUARE) < SQUARE // 2, 1.0, -1.0)
    for row in range(squares):
        for column in range(squares):
            white = (row + column) % 2 == 0
            part = gray[row * SQUARE : (row + 1) * SQUARE, column * SQUARE : (column + 1) * SQUARE]
            part[:] = (200.0 if white else 50.0) + (spread if white else other) * half
            if white:
                part[: round(rim * SQUARE)] = 50.0
    inner = squares - 1
    points = SQUARE * np.stack(np.meshgrid(*[np.arange(1.0, squares)] * 2), -1).reshape(-1, 2) - 0.5
    found = Detection(np.arange(inner**2), points, None, {"square_px": float(SQUARE)})
    return marks.squares_hold_marks(gray, found, (inner, inner))


def test_squares_that_are_not_uniform():
    assert marked(MORE * marks.LEAST_SPREAD * 150) and not marked(LESS * marks.LEAST_SPREAD * 150)
    assert marked(MORE * marks.LEAST_RATIO * 20, 20) and not marked(LESS * marks.LEAST_RATIO * 20, 20)


def test_the_rim_of_a_square():
    """Samples begin half a step of twelve inside the middle part."""
    first = marks.MIDDLE + 0.5 * (1 - 2 * marks.MIDDLE) / marks.SAMPLES
    assert not marked(rim=first - 1.5 / SQUARE) and marked(rim=first + 1.5 / SQUARE)


def test_squares_of_each_colour():
    """Of 2 x 4 whole squares four are dark, of 2 x 3 three; in the white ones every fifth row is brighter."""
    board = np.indices((8, 8)).sum(0) % 2
    gray = np.kron(200.0 - 150 * board, np.ones((SQUARE, SQUARE))).astype(np.float32)
    gray[:: SQUARE // 12] += 100.0 * (gray[:: SQUARE // 12] > 100)
    for columns, marked_ in ((marks.LEAST_SQUARES + 1, True), (marks.LEAST_SQUARES, False)):
        uv = SQUARE * np.stack(np.meshgrid(np.arange(1.0, columns + 1), np.arange(1.0, 4)), -1) - 0.5
        found = Detection(np.arange(3 * columns), uv.reshape(-1, 2), None, {"square_px": float(SQUARE)})
        assert marks.squares_hold_marks(gray, found, (columns, 3)) == marked_
        small = Detection(found.point_ids, found.uv, None, {"square_px": LESS * marks.LEAST_SIDE})
        assert not marks.squares_hold_marks(gray, small, (columns, 3))


# ------------------------------------------------------------------------------------ quadrilaterals
CELL = 8


def like_a_marker(monkeypatch, inside=12, rim=0, contrast=200):
    """Whether a square of 10 x 10 cells, so many of them bright, is kept."""
    cells = np.zeros((quads.RIM, quads.RIM))
    block = np.zeros(36)
    block[:inside] = 1
    cells[2:-2, 2:-2] = block.reshape(6, 6)
    cells[0, 1 : 1 + rim] = 1
    gray = np.pad(np.kron(20 + contrast * cells, np.ones((CELL, CELL))), 10, constant_values=20).astype(
        np.uint8
    )
    low, high = 9.5, 9.5 + CELL * quads.RIM
    quad = np.array([[[low, low], [high, low], [high, high], [low, high]]], np.float32)
    detector = SimpleNamespace(detectMarkers=lambda _: ([quad], None, []))
    monkeypatch.setattr(quads, "detector", lambda *_: detector)
    return len(quads.marker_like(gray)) == 1


def test_a_quadrilateral_that_looks_like_a_marker(monkeypatch):
    """Bright cells of 36 inside, and of 40 samples at the rim."""
    least, most = int(36 * quads.LEAST_INSIDE), int(36 * quads.MOST_INSIDE)
    assert [like_a_marker(monkeypatch, n) for n in (least, least + 1, most, most + 1)] == [0, 1, 1, 0]
    limit = round(40 * quads.DARK_RIM)
    assert like_a_marker(monkeypatch, rim=limit - 1) and not like_a_marker(monkeypatch, rim=limit)
    limit = int(quads.LEAST_CONTRAST)
    assert like_a_marker(monkeypatch, contrast=limit + 1)
    assert not like_a_marker(monkeypatch, contrast=limit)


# ------------------------------------------------------------------------------------ layouts
def patch(columns, rows):
    """Markers of a grid of cv2's, with their places."""
    return Patch(0, {c + columns * r: (c, r) for r in range(rows) for c in range(columns)})


def test_the_longest_row():
    longest = layout.LONGEST_ROW - 1
    for columns, found in ((longest, True), (longest + 1, False)):
        made = layout._tags_in_rows([patch(columns, 2)], 1.3, ("4X4_1000", 1), set())
        assert (made is not None and made.board.columns == columns) == found


def test_the_smallest_charuco_board():
    """Places of the markers of a board of four columns; rows are seen as far as markers reach."""
    for rows, found in ((layout.LEAST_SQUARES, True), (layout.LEAST_SQUARES - 1, False)):
        columns = 7
        ids = range(columns * rows // 2)
        places = {i: layout._charuco_cell(i, columns, 1) for i in ids}
        made = layout._charuco([Patch(0, places)], 1.5, ("4X4_1000", 1), set())
        assert (made is not None and made.board.rows == rows) == found


def test_the_proportions_that_a_layout_begins_with():
    ids = range(7 * 5 // 2)
    places = Patch(0, {i: layout._charuco_cell(i, 7, 1) for i in ids})
    low, high = layout.MARKER
    for marker in (MORE * low, LESS * high):
        assert layout._charuco([places], 1 / marker, ("4X4_1000", 1), set()).board.marker == pytest.approx(
            marker
        )
    for marker, limit in ((LESS * low, low), (MORE * high, high)):
        assert layout._charuco([places], 1 / marker, ("4X4_1000", 1), set()).board.marker == limit
    low, high = base.GAPS
    for gap, expected in (
        (MORE * low, MORE * low),
        (LESS * low, low),
        (LESS * high, LESS * high),
        (MORE * high, high),
    ):
        made = layout._tags_in_rows([patch(4, 3)], 1 + gap, ("4X4_1000", 1), set())
        assert made.board.spacing == pytest.approx(expected)


def in_a_row(count):
    """Markers one beside another, and two far away from them, and from each other."""
    square = 40.0 * (layout.UNIT + 0.5)
    return [[SimpleNamespace(id=i, corners=square + (60.0 * i, 0.0)) for i in range(count)]]


def test_markers_that_neighbours_link():
    """A second row of them, far away, has one marker too few."""
    least = layout.LEAST_PLACED
    (view,) = in_a_row(6)
    for count, patches in ((least, 2), (least - 1, 1)):
        far = [SimpleNamespace(id=10 + m.id, corners=m.corners + (0.0, 3000.0)) for m in view[:count]]
        assert len(layout._patches([view + far], False)[0]) == patches


# ------------------------------------------------------------------------------------ measured proportions
def found_marker(monkeypatch, start, truth):
    """The size that is measured where the correlation is best at `truth`."""
    monkeypatch.setattr(measure, "_grid", lambda *_: np.zeros((1, 1, 2)))
    monkeypatch.setattr(measure, "_decorrelation", lambda ratio, **_: (ratio - truth) ** 2)
    monkeypatch.setattr(measure, "rounded", lambda value, *_: value)
    board = measure.board_with_marker(make("charuco:9x7:1mm:0.5mm:4X4_100"), start)
    return measure._measured_marker(board, [None]).marker


@pytest.mark.parametrize(
    ("start", "low", "high"),
    [
        (0.5, 0.5 * (1 - measure.AROUND), 0.5 * (1 + measure.AROUND)),
        (1.05 * measure.MARKER[0], measure.MARKER[0], 1.05 * measure.MARKER[0] * (1 + measure.AROUND)),
        (0.95 * measure.MARKER[1], 0.95 * measure.MARKER[1] * (1 - measure.AROUND), measure.MARKER[1]),
    ],
)
def test_how_far_a_measured_marker_is_from_its_outline(monkeypatch, start, low, high):
    near = 2 * measure.SOLVED
    for truth in (low + 3 * near, high - 3 * near):
        assert found_marker(monkeypatch, start, truth) == pytest.approx(truth, abs=near)
    assert found_marker(monkeypatch, start, low - 0.05) == pytest.approx(low, abs=near)
    assert found_marker(monkeypatch, start, high + 0.05) == pytest.approx(high, abs=near)


def test_pictures_that_are_measured(monkeypatch):
    asked = []
    monkeypatch.setattr(measure, "_measured_marker", lambda board, pictures: asked.append(len(pictures)))
    for count in (measure.MOST_PICTURES, measure.MOST_PICTURES + 1):
        measure.measured(make("charuco:9x7:1mm:0.5mm:4X4_100"), [None] * count)
    assert asked == [measure.MOST_PICTURES] * 2


# ------------------------------------------------------------------------------------ the place of a grid on its board
def placed(monkeypatch, match, holds=marked_grid.LEAST_MARKERS, other=0.0):
    """Whether a grid whose best place has a mean correlation of `match` is placed, the next best of `other`."""
    scores = iter([(match, holds)] + [(other, 9)] * 3)
    monkeypatch.setattr(marked_grid, "sample_squares", lambda *_: np.zeros((2, 2, 4, 4)))
    monkeypatch.setattr(marked_grid, "_score", lambda *_: next(scores))
    uv = np.stack(np.meshgrid(np.arange(3.0), np.arange(3.0)), -1)
    codes, squares = np.random.default_rng(0).integers(0, 2, (4, 4, 4)), np.zeros((4, 2), int)
    return marked_grid.place_on_board(np.zeros((9, 9)), uv, codes, squares, 0.5, (3, 3)) is not None


def test_a_grid_that_is_placed_by_its_markers(monkeypatch):
    assert placed(monkeypatch, marked_grid.LEAST_MATCH)
    assert not placed(monkeypatch, LESS * marked_grid.LEAST_MATCH)
    assert not placed(monkeypatch, 1.0, marked_grid.LEAST_MARKERS - 1)
    ahead = marked_grid.AHEAD
    assert placed(monkeypatch, 0.8, other=0.8 - MORE * ahead)
    assert not placed(monkeypatch, 0.8, other=0.8 - LESS * ahead)
