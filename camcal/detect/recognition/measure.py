"""Proportions of a board of markers, measured in pictures by means of its fitted corners.

The outlines of small markers are off by about a px, so that a layout gives the size of the markers and the gap
between tags only approximately.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from functools import partial
from typing import TypeVar

import numpy as np

from camcal.detect import targets
from camcal.detect.marked_grid import sample_squares
from camcal.detect.targets.aprilgrid import LARGEST_GAP, AprilGrid
from camcal.detect.targets.base import DEFAULT_SECONDS, GAPS, Detection, Target
from camcal.detect.targets.charuco import Charuco
from camcal.detect.targets.dictionaries import black_cells
from camcal.detect.targets.squares import SquareGrid
from camcal.detect.targets.tag_grid import TagGrid
from camcal.geometry import homography

Array = np.ndarray

Spaced = TypeVar("Spaced", bound=AprilGrid | SquareGrid | TagGrid)

MOST_PICTURES = 3  #: pictures that are measured; the values of single pictures agree to one per cent
AROUND = 0.2  #: relative error of a marker's size taken from its outline
#: range of the gap in sides
BOUNDS = {"aprilgrid": (GAPS[0], LARGEST_GAP), "squares": GAPS, "aruco-grid": GAPS}
#: range of a marker's side in squares: printed markers have some white around them
MARKER = (0.1, 0.98)
#: usual multiples for the side of a marker (in squares) and for a gap (in sides), and the distance within which a
#: measured value is rounded to one: six and eight of ten values are
MARKER_STEP, MARKER_NEAR = 0.05, 0.015
GAP_STEP, GAP_NEAR = 0.01, 0.004
SOLVED = 1e-3  #: accuracy of the minimum: of a marker in squares; of a gap a tenth of this
ROUNDS = 2  #: of measuring the gap: the second uses corners that the first value did not reach
GROSS = 10.0  #: times the median misfit above which a block of tags contains a wrong corner and is ignored


def measured(board: Target, pictures: Sequence[Array]) -> Target:
    """The same board with its proportions measured in a few of the pictures that show it."""
    if isinstance(board, Charuco):
        return _measured_marker(board, pictures[:MOST_PICTURES])
    if isinstance(board, (AprilGrid, SquareGrid, TagGrid)):
        return _measured_spacing(board, pictures[:MOST_PICTURES])
    return board


def _measured_marker(board: Charuco, pictures: Sequence[Array]) -> Charuco:
    """The board with the marker size that correlates best with the pictures."""
    seen = [(gray, uv) for gray in pictures if (uv := _grid(board, gray)) is not None]
    if seen:
        ratio = board.marker
        bounds = (max(MARKER[0], (1 - AROUND) * ratio), min(MARKER[1], (1 + AROUND) * ratio))
        cost = partial(_decorrelation, seen=seen, codes=_codes(board), squares=_squares(board))
        from scipy import optimize  # needed for boards with markers only, and slow to import

        ratio = float(
            optimize.minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": SOLVED}).x
        )
        board = board_with_marker(board, ratio)
    return board_with_marker(board, rounded(board.marker, MARKER_STEP, MARKER_NEAR))


def board_with_marker(board: Charuco, marker: float) -> Charuco:
    """The same board with markers of another size."""
    lengths = (board.square, marker)
    return Charuco(
        board.columns, board.rows, *lengths, board.dictionary, board.unit, board.legacy, board.start
    )


def _grid(board: Charuco, gray: Array) -> Array | None:
    """The corners (rows, columns, 2) of a picture, NaN for missing ones."""
    found = targets.find(board, gray, DEFAULT_SECONDS)
    if not isinstance(found, Detection):
        return None
    uv = np.full((len(board.points), 2), np.nan)
    uv[found.point_ids] = found.uv
    return uv.reshape(board.rows - 1, board.columns - 1, 2)


def _squares(board: Charuco) -> Array:
    """The column and row (K, 2) of each marker's square, counted from the first inner corner."""
    return np.floor(board.tag_corners[:, 0] / board.square).astype(int) - 1


def _codes(board: Charuco) -> Array:
    """The cells of each marker (K, n, n), of mean 0 and norm 1."""
    codes = np.array([~black_cells(board.dictionary, int(m)) for m in board.tag_ids], float)
    codes -= codes.mean((1, 2), keepdims=True)
    return codes / np.linalg.norm(codes, axis=(1, 2), keepdims=True)


def _decorrelation(ratio: float, seen: Sequence[tuple[Array, Array]], codes: Array, squares: Array) -> float:
    """The negative mean correlation of the markers with their squares, for a given marker size."""
    values = []
    for gray, uv in seen:
        cells = sample_squares(gray, uv, ratio, codes.shape[-1])
        inside = ((squares >= 0) & (squares < (cells.shape[1], cells.shape[0]))).all(1)
        column, row = squares[inside].T
        values.append((cells[row, column] * codes[inside]).sum((1, 2)))
    return -float(np.nanmean(np.concatenate(values)))


def _measured_spacing(grid: Spaced, pictures: Sequence[Array]) -> Spaced:
    """The grid with the spacing for which homographies fit blocks of four tags best."""
    from scipy import optimize  # as above

    for _ in range(ROUNDS):
        found = [d for d in map(grid.find, pictures) if isinstance(d, Detection)]
        blocks = [_blocks(grid, d) for d in found]
        ids = np.concatenate([b for b, _ in blocks] or [np.zeros((0, 16), int)])
        if not len(ids):
            break
        uv = np.concatenate([u for _, u in blocks])
        misfit = partial(_misfit, grid=grid, ids=ids, uv=uv)
        best = optimize.minimize_scalar(
            misfit, bounds=BOUNDS[grid.kind], method="bounded", options={"xatol": 0.1 * SOLVED}
        )
        grid = grid_with_spacing(grid, float(best.x))
    return grid_with_spacing(grid, rounded(grid.spacing, GAP_STEP, GAP_NEAR))


def _misfit(spacing: float, grid: Spaced, ids: Array, uv: Array) -> float:
    """The sum of the residuals of a homography for each block of points (B, 16), with equal weights, px²."""
    cost = homography.solve(grid_with_spacing(grid, spacing).points[ids, :2], uv)[2]
    return float(np.minimum(cost, GROSS * np.median(cost)).sum())


def _blocks(grid: Spaced, found: Detection) -> tuple[Array, Array]:
    """Points (B, 16) of two by two tags whose corners were all found, and their images (B, 16, 2)."""
    tag = np.arange(grid.columns * grid.rows).reshape(grid.rows, grid.columns)
    four = np.stack([tag[:-1, :-1], tag[:-1, 1:], tag[1:, :-1], tag[1:, 1:]], -1).reshape(-1, 4)
    ids = (4 * four[:, :, None] + np.arange(4)).reshape(-1, 16)
    where = np.full(4 * tag.size, -1)
    where[found.point_ids] = np.arange(len(found))
    rows = where[ids]
    whole = (rows >= 0).all(1)
    return ids[whole], found.uv[rows[whole]]


def grid_with_spacing(grid: Spaced, spacing: float) -> Spaced:
    """The same grid with another spacing."""
    made = copy(grid)
    made.spacing = spacing
    return made


def rounded(value: float, step: float, near: float) -> float:
    """Round to the nearest multiple of a step, a likely design value, if it is close; otherwise to three digits."""
    whole = round(round(value / step) * step, 6)
    return whole if abs(whole - value) < near else round(value, 3)
