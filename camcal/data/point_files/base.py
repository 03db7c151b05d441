"""The interface of readers of other programs' points: the result is a table like any other."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence

import numpy as np

from camcal.data.formats.source import Source
from camcal.data.table import LARGEST_VALUE, Table
from camcal.errors import DataError
from camcal.records import dataclass

Array = np.ndarray
Size = tuple[int, int]


@dataclass(frozen=True)
class Board:
    """Values from the command line: inner corners, columns x rows, the side of a square, and the selected camera."""

    grid: Size | None = None
    square: float = 1.0
    camera: str | None = None

    def points(self, count: int, source: str) -> Array:
        """The points (count, 3) of a board whose corners are listed row by row.

        Without a size, a square number of corners is a square board.

        Raises
        ------
        DataError
            If the size is not known, or another than the number of corners.
        """
        columns, rows = self.grid or (round(count**0.5),) * 2
        if columns * rows != count:
            found = f"{count} corners per picture"
            needed = f"{columns}x{rows} = {columns * rows}" if self.grid else "the size of the board"
            raise DataError(f"{source}: {found}; {needed} is needed.", "Give --board COLUMNSxROWS.")
        x, y = np.meshgrid(np.arange(columns), np.arange(rows))
        return np.c_[x.ravel(), y.ravel(), np.zeros(count)] * self.square


@dataclass(frozen=True)
class Reader:
    """How a kind of file is recognised, and read into a table and an image size."""

    title: str
    sniff: Callable[[Source], bool]
    read: Callable[[Source, Board], tuple[Table, Size | None]]


def one_camera(source: Source, names: Sequence[str], board: Board) -> int:
    """Select one camera of a file.

    Raises
    ------
    DataError
        If there are several and none is named, or the name is none of them.
    """
    known = ", ".join(names[:20])
    if board.camera is not None:
        if board.camera not in names:
            raise DataError(f"'{source.path}' has no camera '{board.camera}'.", f"It has: {known}.")
        return list(names).index(board.camera)
    if len(names) > 1:
        raise DataError(
            f"'{source.path}' holds the points of {len(names)} cameras ({known}); one is needed.",
            f"Name it: '{source.path}#{names[0]}'.",
        )
    return 0


def table_of(source: Source, views: Sequence[tuple[str, Array, Array, Array | None]]) -> Table:
    """Make a table from (name, xyz (N, 3), uv (N, 2), ids (N,) or None) of each view.

    Raises
    ------
    DataError
        If no view has a point, or a coordinate is not finite.
    """
    kept = [v for v in views if len(v[1])]
    if not kept:
        raise DataError(f"{source.path}: it has no picture with points.", "Is it the right file?")
    with_ids = all(ids is not None for *_, ids in kept)
    columns = ("X", "Y", "Z", "u", "v", *(("id",) if with_ids else ()))
    blocks = [np.c_[xyz, uv, ids] if with_ids else np.c_[xyz, uv] for _, xyz, uv, ids in kept]
    values = np.concatenate(blocks).astype(float)
    if not (np.abs(values) <= LARGEST_VALUE).all():
        said = f"a coordinate is not finite, or above {LARGEST_VALUE:g}"
        raise DataError(f"{source.path}: {said}.", "Remove that point.")
    index = np.repeat(np.arange(len(kept)), [len(b) for b in blocks])
    names = tuple(name for name, *_ in kept)
    digest = hashlib.sha256(source.data).hexdigest()
    return Table(str(source.path), digest, columns, values, names, index, shape=(len(values),))
