"""Corners of TartanCalib: `corners.mat` with `board.mat` (`--outputMatlab`), and its data set
(`--export-dataset-dir`).

BabelCalib takes the .mat. Of each picture `x` are the pixels (2, N) and `cspond` the numbers of point and board, from
1; of each board `X` are the points (2, M) and `Rt` the pose. TartanCalib counts pixels from 0; BabelCalib's own files,
which MATLAB writes, count them from 1. The data set is binary: whole numbers big-endian, pixels and places
little-endian floats. Source: TartanCalib, tartan_calibrate and TartanCalibWorker; BabelCalib, core/feature.
"""

from __future__ import annotations

import struct
from typing import Any

import numpy as np

from camcal.data.formats.base import floats
from camcal.data.formats.source import Source
from camcal.data.point_files.base import Array, Board, Reader, Size, one_camera, table_of
from camcal.data.table import Table
from camcal.errors import DataError

MAGIC = b"calib_data"
#: the version of TartanCalib; 0, of the program that it was made for, has whole numbers as places
VERSION = 1
#: how the text that begins a .mat of MATLAB's own differs from scipy's, by which TartanCalib writes
OF_MATLAB = b"MATLAB 5.0 MAT-file, Platform"


def _sniff_mat(source: Source) -> bool:
    return source.kind == "mat" and "corners" in source.mat


def _read_mat(source: Source, board: Board) -> tuple[Table, Size | None]:
    found = source.mat
    if "boards" not in found:
        beside = source.neighbour("board.mat")
        if beside is None or "boards" not in beside.mat:
            raise DataError(
                f"{source.path}: the points of the board are neither in it nor in a board.mat in the same folder.",
                "Put TartanCalib's board.mat there.",
            )
        found = {**found, "boards": beside.mat["boards"]}
    boards = [_board(b) for b in _listed(found["boards"])]
    first = 1.0 if source.data.startswith(OF_MATLAB) else 0.0
    views = []
    for i, corners in enumerate(_listed(found["corners"]), 1):
        pixels = _columns(corners.x)
        numbers = _columns(corners.cspond).astype(int)
        if len(numbers) != len(pixels):
            raise ValueError(f"picture {i} has {len(pixels)} pixels but {len(numbers)} point numbers")
        points = [_point(boards, p, b) for p, b in numbers.tolist()]
        before = np.cumsum([0, *map(len, boards)])
        ids = numbers[:, 0] - 1 + before[numbers[:, 1] - 1]
        views.append((f"view{i}", np.array(points).reshape(-1, 3), pixels - first, ids))
    size = None
    if "imgsize" in found:
        rows, columns = floats(found["imgsize"], 2, "imgsize")
        size = int(columns), int(rows)
    return table_of(source, views), size


def _listed(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [value]


def _columns(values: Any) -> Array:
    """The columns of a MATLAB matrix of two rows as rows; a single column is stored as a vector."""
    found = np.asarray(values, float)
    return found.reshape(2, -1).T if found.size else np.zeros((0, 2))


def _board(entry: Any) -> Array:
    """The points of a board (M, 3) in the frame of all boards."""
    flat = _columns(entry.X)
    pose = floats(entry.Rt, 12, "Rt").reshape(3, 4)
    return np.asarray(np.c_[flat, np.zeros(len(flat))] @ pose[:, :3].T + pose[:, 3])


def _point(boards: list[Array], point: int, board: int) -> Array:
    if not (1 <= board <= len(boards) and 1 <= point <= len(boards[board - 1])):
        raise ValueError(f"point {point} of board {board} is not on the board")
    return np.asarray(boards[board - 1][point - 1])


def _sniff_dataset(source: Source) -> bool:
    return source.data.startswith(MAGIC)


class _Stream:
    """A sequence of numbers, each checked against the remaining bytes."""

    def __init__(self, data: bytes):
        self.data, self.at = data, len(MAGIC)

    def take(self, form: str) -> tuple[Any, ...]:
        """The next numbers; struct.error if the file is too short."""
        found = struct.unpack_from(form, self.data, self.at)
        self.at += struct.calcsize(form)
        return found

    def count(self, size: int) -> int:
        """A number of entries of a given size in bytes; ValueError if they exceed the file."""
        (n,) = self.take(">I")
        if n * size > len(self.data) - self.at:
            raise ValueError(f"{n} entries do not fit into the file")
        return int(n)

    def rows(self, kind: np.dtype) -> Array:
        """A counted list of entries."""
        n = self.count(kind.itemsize)
        found = np.frombuffer(self.data, kind, n, self.at)
        self.at += n * kind.itemsize
        return found


FEATURE = np.dtype([("u", "<f4"), ("v", "<f4"), ("id", ">i4")])
PLACE = np.dtype([("id", ">i4"), ("x", "<f4"), ("y", "<f4")])


def _read_dataset(source: Source, board: Board) -> tuple[Table, Size | None]:
    stream = _Stream(source.data)
    (version,) = stream.take(">I")
    if version != VERSION:
        raise DataError(
            f"{source.path}: the data set has version {version}; only {VERSION} (TartanCalib) is read.",
            "Export the corners as a table.",
        )
    sizes = [stream.take(">II") for _ in range(stream.count(8))]
    chosen = one_camera(source, [f"cam{i}" for i in range(len(sizes))], board)
    pictures = []
    for _ in range(stream.count(4)):
        length = stream.count(1)
        name = bytes(stream.take(f">{length}s")[0]).decode("utf-8", "replace")
        seen = [stream.rows(FEATURE) for _ in sizes]
        pictures.append((name, seen[chosen]))
    places: dict[int, tuple[float, float]] = {}
    for _ in range(stream.count(12)):
        stream.take(">ii")  # rows and columns of the target
        places |= {int(i): (float(x), float(y)) for i, x, y in stream.rows(PLACE)}
    names = [n for n, _ in pictures]
    views = []
    for i, (name, rows) in enumerate(pictures, 1):
        ids = rows["id"].astype(int)
        lost = [int(n) for n in ids if int(n) not in places]
        if lost:
            raise ValueError(f"point {lost[0]} is not on the target")
        xyz = np.array([[*places[int(n)], 0.0] for n in ids]).reshape(-1, 3)
        unique = name if names.count(name) == 1 and name.strip() else f"view{i}"
        views.append((unique, xyz, np.c_[rows["u"], rows["v"]].astype(float), ids))
    return table_of(source, views), sizes[chosen]


MATLAB = Reader("corners of TartanCalib and BabelCalib (.mat)", _sniff_mat, _read_mat)
DATASET = Reader("a data set of TartanCalib", _sniff_dataset, _read_dataset)
