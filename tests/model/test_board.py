"""Boards: ids, plane, and what is refused."""

import re

import numpy as np
import pytest

from camcal.errors import DataError
from camcal.model.board import PLANAR, Board


def test_grid():
    board = Board.grid(9, 6, 25.0, "mm")
    assert len(board) == 54 and board.planar and board.unit == "mm"
    np.testing.assert_array_equal(board.of([0, 8, 9]), [[0, 0, 0], [200, 0, 0], [0, 25, 0]])
    assert board.extent == pytest.approx(25 * np.hypot(8, 5))
    assert repr(board) == "<Board of 54 points, planar, 235.85 mm across>"


def test_points_by_id():
    board = Board(np.eye(3), ids=np.array([12, 5, 30]))
    np.testing.assert_array_equal(board.of([30, 12]), [[0, 0, 1], [1, 0, 0]])
    for wrong in (4, 6, 31):
        with pytest.raises(DataError, match=f"no point with the id {wrong}"):
            board.of([5, wrong])


def test_the_plane_may_be_any():
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    flat = Board.grid(4, 3).points @ turn + 7
    assert Board(flat).planar and not Board(np.r_[flat, [[0.0, 0, 0]]]).planar
    assert Board(flat[:2]).planar and Board(flat[:1]).planar
    # one point lifted off the plane, by less and by more than the limit
    board = Board.grid(9, 6)
    for part, planar in ((0.5, True), (2.0, False)):
        points = np.array(board.points)
        points[30, 2] = part * PLANAR * board.extent
        assert Board(points).planar is planar


def test_nothing_changes_it():
    given = np.zeros((2, 3))
    board = Board(given)
    given[0] = 5
    assert not board.points.any()
    with pytest.raises(ValueError, match="read-only"):
        board.points[0] = 1


@pytest.mark.parametrize(
    "points, ids, said",
    [
        (np.zeros((0, 3)), None, "(0, 3)"),
        (np.zeros((4, 4)), None, "(4, 4)"),
        ([[0, 0, 0], [1, np.nan, 0]], None, "point 1 of the board"),
        (np.zeros((2, 3)), [1], "as many integer ids"),
        (np.zeros((2, 3)), [1.0, 2.0], "as many integer ids"),
        (np.zeros((3, 3)), [1, 4, 4], "2 points with the id 4"),
    ],
)
def test_refused(points, ids, said):
    with pytest.raises(DataError, match=re.escape(said)):
        Board(np.array(points, float), ids)
