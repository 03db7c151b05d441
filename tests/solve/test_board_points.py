"""Rows of observations that are a board's points, however they are found."""

import numpy as np
import pytest

from camcal.data.observations import Observations, View
from camcal.solve import board_points

IDEAL = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [1, 1, 0.5]])
FOUND = IDEAL + 0.01


def moved(xyz):
    data = Observations.from_views([View("a", xyz, np.zeros((len(xyz), 2)))], (640, 480))
    return board_points.on_board(data, IDEAL, FOUND).xyz


def test_copies_of_the_points_need_no_search(monkeypatch):
    monkeypatch.setattr(board_points, "Neighbours", None)
    rows = np.array([3, 0, 0, 2, 1])
    np.testing.assert_array_equal(moved(IDEAL[rows]), FOUND[rows])


def test_a_point_above_another_is_told_from_it():
    np.testing.assert_array_equal(moved(IDEAL[[4, 3]]), FOUND[[4, 3]])


@pytest.mark.parametrize("off, same", [(0.5e-6, True), (2e-6, False)])
def test_points_printed_with_few_digits(off, same):
    near = IDEAL[[1, 2]] + off * np.array([1.0, 0, 0])
    np.testing.assert_array_equal(moved(near), FOUND[[1, 2]] if same else near)
