"""Corners of deltille, as used by BabelCalib: an `.orpc` file per picture, the target in a `.dsc` (and a `.tp`).

A row is `board, corner, ordered, u, v`; (0, 0) is the centre of the top-left pixel. The `.dsc` lists the corners of
each board in cm, y up; the `.tp` has the pose of each board in the frame of the target, in mm. Source: BabelCalib,
core/feature/parse; deltille, apps.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from camcal.data.formats.base import floats, image_size
from camcal.data.formats.source import Source
from camcal.data.point_files.base import Array, Board, Reader, Size, table_of
from camcal.data.table import Table
from camcal.errors import DataError

HEAD = ("filename", "width", "height", "num_corners", "encoding")
#: mm in the .dsc's unit
CENTIMETRE = 10.0
#: folders above the .orpc in which the .dsc is looked for: BabelCalib keeps corners in TARGET/corners/train
ABOVE = 3


def _sniff(source: Source) -> bool:
    return source.suffix == ".orpc"


def _read(source: Source, board: Board) -> tuple[Table, Size | None]:
    lines = (source.text or "").splitlines()
    head = dict(line.split(": ", 1) for line in lines[: len(HEAD)] if ": " in line)
    missing = [name for name in HEAD[:4] if name not in head]
    if missing:
        raise DataError(f"{source.path}: '{missing[0]}' is missing.", "Is it a .orpc of deltille?")
    rows = _rows(source, lines[len(HEAD) :])
    if len(rows) != int(head["num_corners"]):
        raise DataError(
            f"{source.path}: {len(rows)} corners; it says {head['num_corners']}.", "Is it complete?"
        )
    name = head["filename"].replace("\\", "/").rpartition("/")[2] or source.path.name
    views = list(_views(source, name, rows, board))
    return table_of(source, views), image_size(head["width"], head["height"])


def _rows(source: Source, lines: list[str]) -> Array:
    """Board, corner, u, v of each row (N, 4)."""
    found = []
    for number, line in enumerate(lines, len(HEAD) + 1):
        if not line.strip():
            continue
        try:
            b, corner, _, u, v = map(float, line.split(","))
        except ValueError:
            raise DataError(
                f"{source.path}:{number}: board, corner, ordered, u, v are needed in a row.",
                "Correct or remove it.",
            ) from None
        found.append((b, corner, u, v))
    return np.array(found).reshape(-1, 4)


def _views(
    source: Source, name: str, rows: Array, board: Board
) -> Iterator[tuple[str, Array, Array, Array | None]]:
    """One view of all boards if their poses are known, otherwise one view per board."""
    if (rows[:, :2] != np.rint(rows[:, :2])).any() or (rows[:, :2] < 0).any():
        raise ValueError("boards and corners are numbered from 0")
    boards, corners = rows[:, 0].astype(int), rows[:, 1].astype(int)
    target = _target(source.path)
    points, poses = target or ({}, {})
    xyz = _on_grid(source, corners, board) if target is None else _on_target(source, boards, corners, points)
    if len(boards) and set(boards.tolist()) <= set(poses):
        first = dict(zip(points, np.cumsum([0, *map(len, points.values())]).tolist(), strict=False))
        moved = [poses[b][:, :3] @ p + poses[b][:, 3] for b, p in zip(boards.tolist(), xyz, strict=True)]
        yield name, np.array(moved), rows[:, 2:], np.array([first[b] for b in boards.tolist()]) + corners
        return
    for b in np.unique(boards):
        mine = boards == b
        yield _name(name, b, boards), xyz[mine], rows[mine, 2:], corners[mine]


def _on_target(source: Source, boards: Array, corners: Array, points: dict[int, Array]) -> Array:
    """Positions of corners (N, 3) on their boards."""
    placed = []
    for b, corner in zip(boards.tolist(), corners.tolist(), strict=True):
        if b not in points or corner >= len(points[b]):
            raise DataError(
                f"{source.path}: corner {corner} of board {b} is not in the .dsc.", "Is it the right target?"
            )
        placed.append(points[b][corner])
    return np.array(placed).reshape(-1, 3)


def _name(name: str, board: int, boards: Array) -> str:
    return name if len(np.unique(boards)) == 1 else f"{name} board {board}"


def _on_grid(source: Source, corners: Array, board: Board) -> Array:
    """Positions of corners that are numbered row by row on the board of the command line."""
    if board.grid is None:
        raise DataError(
            f"{source.path}: its target (a .dsc file) is not in the same folder.",
            "Put it there, or give --board COLUMNSxROWS and --square.",
        )
    columns, rows = board.grid
    if len(corners) and corners.max() >= columns * rows:
        raise DataError(
            f"{source.path}: corner {corners.max()}; a board of {columns}x{rows} has {columns * rows}.",
            "Give the right --board.",
        )
    return np.c_[corners % columns, corners // columns, np.zeros(len(corners))] * board.square


def _target(path: Path) -> tuple[dict[int, Array], dict[int, Array]] | None:
    """Points (N, 3) and, with a .tp file, the pose (3, 4) of each board, mm; None without a .dsc file."""
    for folder in list(path.absolute().parents)[:ABOVE]:
        found = sorted(folder.glob("*.dsc"))
        if len(found) > 1:
            raise DataError(
                f"'{folder}' holds {len(found)} targets (.dsc).", "Keep only the .dsc file of these pictures."
            )
        if found:
            poses = found[0].with_suffix(".tp")
            return _boards(Source(found[0])), _poses(Source(poses)) if poses.is_file() else {}
    return None


def _boards(source: Source) -> dict[int, Array]:
    """The corners of each board, in numbering order."""
    lines = iter((source.text or "").splitlines())
    found: dict[int, Array] = {}
    for line in lines:
        if not line.strip():
            continue
        number, rows, columns, _ = floats(line.split(","), 4, f"the board of {source.path}")
        if columns == 0:
            raise DataError(
                f"'{source.path}' describes a triangular board; only rectangular boards are read.",
                "Detect a rectangular board.",
            )
        count = int((rows - 1) * (columns - 1))
        if not 0 < count <= len(source.data):
            raise DataError(f"'{source.path}': a board of {rows:g}x{columns:g}.", "Is the file damaged?")
        listed = list(itertools.islice(lines, 1, count + 1))  # after the family of the tags
        if len(listed) < count:
            raise DataError(f"'{source.path}' ends within board {number:g}.", "Is it complete?")
        nodes = [floats(t.split(","), 6, f"a corner of {source.path}") for t in listed]
        found[int(number)] = np.array(nodes)[:, 3:] * CENTIMETRE
    return found


def _poses(source: Source) -> dict[int, Array]:
    """The pose (3, 4) of each board: its number, then the rows."""
    words = floats((source.text or "").split("\n", 1)[-1].split(), what=str(source.path))
    if len(words) % 13:
        raise DataError(
            f"'{source.path}': {len(words)} numbers were found; 13 for each board are needed.",
            "Is it complete?",
        )
    return {int(w[0]): w[1:].reshape(3, 4) for w in words.reshape(-1, 13)}


READER = Reader("corners of deltille (BabelCalib)", _sniff, _read)
