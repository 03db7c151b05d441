"""The points of boards within observations: as designed, or as estimated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from camcal.data.observations import Observations
from camcal.geometry.neighbours import Neighbours
from camcal.model.pose import Array
from camcal.solve.board import Board
from camcal.solve.calibration import ShapedBoard

#: points of a board closer than this fraction of its coordinates are identical up to the rounding of printed digits
_SAME_POINT = 1e-6


def shaped_board(board: Board, points: Array) -> ShapedBoard:
    """A board with its points at the estimated positions."""
    return ShapedBoard(
        board.kind,
        board.points,
        points,
        board.size,
        board.basis,
        board.placed,
        board.label,
        board.numbers,
    )


def shaped(observations: Observations, board: ShapedBoard) -> Observations:
    """The observations with the points of one or several boards at the estimated positions."""
    if board.numbers is None:
        return on_board(observations, board.ideal, board.points)
    return by_number(observations, board.numbers, board.points)


def by_number(observations: Observations, numbers: Array, points: Array) -> Observations:
    """The observations with points (M, 3) of given numbers (M,); others remain unchanged."""
    assert observations.point is not None
    index = np.minimum(np.searchsorted(numbers, observations.point), len(numbers) - 1)
    known = numbers[index] == observations.point
    return replace(observations, xyz=np.where(known[:, None], points[index], observations.xyz))


def on_board(observations: Observations, ideal: Array, points: Array) -> Observations:
    """The observations with the ideal points (M, 3) replaced by the estimated ones (M, 3).

    Points that are not among the ideal ones (because no used view shows them) remain unchanged.
    """
    xyz = observations.xyz
    index, same = _equal_rows(xyz, ideal)
    moved = np.where(same[:, None], points[index], xyz)
    if not same.all():
        near = _SAME_POINT * float(np.abs(ideal).max(initial=0.0))
        rest = np.flatnonzero(~same)
        distance, index = Neighbours(ideal).query(xyz[rest])
        moved[rest] = np.where(distance[:, None] <= near, points[index], xyz[rest])
    return replace(observations, xyz=moved)


def _equal_rows(xyz: Array, ideal: Array) -> tuple[Array, Array]:
    """The point (N,) of `ideal` (M, 3) that each row of `xyz` (N, 3) may equal, and whether it does (N,).

    Most rows are copies of the board's points, and need no search for the nearest. Of points with the same x and y
    only the first is compared, so that rows equal to another of them are reported as different.
    """
    key, wanted = (a[:, 0] + 1j * a[:, 1] for a in (ideal, xyz))  # complex numbers are sorted by x, then by y
    order = np.argsort(key, kind="stable")
    place = np.minimum(np.searchsorted(key[order], wanted), len(key) - 1)
    index = order[place]
    return index, (ideal[index] == xyz).all(1)
