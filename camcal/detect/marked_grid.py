"""The position of a grid of corners on a ChArUco board, from all of its markers jointly.

A marker of a few pixels cannot be read by itself, but all markers can be read jointly: the grey values of each white
square are correlated with every marker of the board, in four orientations, and the position of the grid on the board
is the one with the largest sum of correlations.
"""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from camcal.geometry import homography

Array = np.ndarray

PER_CELL = 3  #: samples along each side of a marker's cell: those of a 3 px cell cover all of its pixels
#: mean correlation of the best position; by chance that of a marker of 16 cells is 0 ± .25, that of 4 markers 0 ± .13
LEAST_MATCH = 0.45
AHEAD = 0.15  #: by which it must exceed every other: about one such standard deviation
LEAST_MARKERS = 2  #: least number within the grid; in noise, single markers are confused


def place_on_board(
    gray: Array, uv: Array, codes: Array, squares: Array, marker: float, size: tuple[int, int]
) -> tuple[Array, Array] | None:
    """Find the position of a grid on its board.

    Parameters
    ----------
    gray : (height, width) array
    uv : (R, C, 2) array
        Corners, px, the turn from columns to rows clockwise; NaN for missing ones.
    codes : (K, n, n) array
        The board's markers, 1 where bright and 0 where black.
    squares : (K, 2) int array
        Column and row of the square of each.
    marker : float
        Side of a marker as a share of the square.
    size : (columns, rows)
        Inner corners of the board.

    Returns
    -------
    ids : (N,) int array
        row * columns + column of each corner.
    uv : (N, 2) array
        None is returned instead if no position or more than one explains the picture.
    """
    cells = sample_squares(gray, uv, marker, codes.shape[-1])
    flat = codes.reshape(len(codes), -1) - codes.reshape(len(codes), -1).mean(1, keepdims=True)
    flat = flat / np.linalg.norm(flat, axis=1, keepdims=True)
    where = {(int(c), int(r)): k for k, (c, r) in enumerate(squares)}
    found = []
    for quarter in range(4):
        turned = np.rot90(cells, quarter, (0, 1))
        turned = np.rot90(turned, quarter, (2, 3))
        match = turned.reshape(*turned.shape[:2], -1) @ flat.T
        corners = np.rot90(uv, quarter)
        for down, right in _offsets(corners.shape, size):
            score, number = _score(match, where, down, right)
            if number >= LEAST_MARKERS:
                found.append((score, quarter, down, right))
    if not found:
        return None
    found.sort(reverse=True)
    if found[0][0] < LEAST_MATCH or (len(found) > 1 and found[0][0] - found[1][0] < AHEAD):
        return None
    _, quarter, down, right = found[0]
    corners = np.rot90(uv, quarter)
    row, column = np.nonzero(np.isfinite(corners[..., 0]))
    on_board = (row + down >= 0) & (row + down < size[1]) & (column + right >= 0) & (column + right < size[0])
    row, column = row[on_board], column[on_board]
    return (row + down) * size[0] + column + right, corners[row, column]


def _offsets(shape: tuple[int, ...], size: tuple[int, int]) -> Iterator[tuple[int, int]]:
    """The possible positions of the grid's first corner on the board; the smaller of the two lies within the
    larger.
    """
    rows, columns = size[1] - shape[0], size[0] - shape[1]
    for down in range(min(0, rows), max(0, rows) + 1):
        for right in range(min(0, columns), max(0, columns) + 1):
            yield down, right


def _score(match: Array, where: dict[tuple[int, int], int], down: int, right: int) -> tuple[float, int]:
    """The mean correlation over the squares that hold a marker, and their number."""
    values = []
    for row, column in np.ndindex(match.shape[:2]):
        marker = where.get(
            (column + right + 1, row + down + 1)
        )  # the square after inner corner (row, column)
        if marker is not None and np.isfinite(match[row, column, marker]):
            values.append(match[row, column, marker])
    return (float(np.mean(values)) if values else 0.0), len(values)


def sample_squares(gray: Array, uv: Array, marker: float, count: int) -> Array:
    """Mean grey values of the marker's cells in each square (R - 1, C - 1, n, n), of mean 0 and norm 1."""
    rows, columns = uv.shape[0] - 1, uv.shape[1] - 1
    corners = np.stack([uv[:-1, :-1], uv[:-1, 1:], uv[1:, 1:], uv[1:, :-1]], 2).reshape(-1, 4, 2)
    known = np.isfinite(corners).all((1, 2))
    out = np.full((rows * columns, count, count), np.nan)
    if known.any():
        n = count * PER_CELL
        at = (1 - marker) / 2 + marker * (np.arange(n) + 0.5) / n
        x, y = (a.reshape(-1, n * n).astype(np.float32) for a in homography.within_quads(corners[known], at))
        value = cv2.remap(
            gray.astype(np.float32),
            x,
            y,
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )
        cells = value.reshape(-1, count, PER_CELL, count, PER_CELL).mean((2, 4))
        cells -= cells.mean((1, 2), keepdims=True)
        out[known] = cells / np.maximum(np.linalg.norm(cells, axis=(1, 2), keepdims=True), 1e-6)
    return out.reshape(rows, columns, count, count)
