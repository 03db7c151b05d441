"""Frames from a table of points, read in blocks: a file of any length, or a pipe as it fills.

Columns `frame,X,Y,Z,u,v[,sigma][,t]`, named by a header in any order (camcal.data.columns knows their other
names), or these six without one. The rows of a
frame follow each other. A frame is complete when a row of another frame, an empty line or the end comes;
a program that feeds a pipe ends each frame with an empty line to have its answer at once.

A row whose X, Y, Z, u or v is empty or `nan` is a missing point: it is left out, its frame stays.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import BinaryIO

import numpy as np

from camcal.data.blocks import LONGEST_LINE
from camcal.data.columns import FRAMES, plain, role_of, shown
from camcal.data.table import LARGEST_VALUE
from camcal.errors import DataError
from camcal.registry import suggestion
from camcal.track.frames import Frame

Array = np.ndarray

NEEDED = ("frame", "X", "Y", "Z", "u", "v")
OPTIONAL = ("sigma", "t")
#: a column that may be there and says nothing here
UNUSED = "id"
#: bytes at a time: about 100 frames of 50 points
BLOCK = 1 << 19

_FORM = ",".join(NEEDED) + "[,sigma][,t]"


class FrameReader:
    """Iterates over the frames of a binary stream.

    Parameters
    ----------
    stream : binary file
        What it has is taken as it comes, by `read1` where there is one.
    name : str
        For messages.
    before_read : callable
        Called before each read, which may wait: all frames that were complete have been taken by then.

    Raises
    ------
    DataError
        While iterating, with the line: a wrong number of fields, text, an infinite number, a frame that is
        not a whole number, a sigma that is not positive; and where there is no frame at all.
    """

    def __init__(self, stream: BinaryIO, name: str, before_read: Callable[[], object] = lambda: None):
        self.stream, self.name, self.before_read = stream, name, before_read
        self.columns: tuple[str, ...] = ()
        self.delimiter: str | None = ","
        self.line = 0
        self._rows_so_far: list[Array] = []

    def __iter__(self) -> Iterator[Frame]:
        count = 0
        for lines in self._line_blocks():
            for frame in self._frames(lines):
                count += 1
                yield frame
        if self._rows_so_far:
            count += 1
            yield self._close()
        if not count:
            raise DataError(f"{self.name}: no frames.", f"Rows {_FORM} are needed.")

    # ------------------------------------------------------------------ lines
    def _line_blocks(self) -> Iterator[list[str]]:
        """Whole lines, as many as have arrived."""
        read = getattr(self.stream, "read1", self.stream.read)
        rest = b""
        while True:
            self.before_read()
            data = read(BLOCK)
            if not data:
                break
            head, newline, tail = data.rpartition(b"\n")
            if newline:
                yield self._text(rest + head).split("\n")
                rest = tail
            else:
                rest += data
            if len(rest) > LONGEST_LINE:
                where = f"{self.name}:{self.line + 1}"
                raise DataError(
                    f"{where}: a line of more than {LONGEST_LINE} bytes.", f"Rows {_FORM} are needed."
                )
        if rest.strip():
            yield [self._text(rest)]

    def _text(self, data: bytes) -> str:
        try:
            return data.decode("utf-8-sig" if self.line == 0 else "utf-8")
        except UnicodeDecodeError:
            raise DataError(f"{self.name}: not a text file.", f"Rows {_FORM} are needed.") from None

    def _frames(self, lines: list[str]) -> Iterator[Frame]:
        first = self.line + 1
        self.line += len(lines)
        lines = [line.rstrip("\r") for line in lines]
        if not self.columns:
            first, lines = self._header(first, lines)
        run: list[str] = []
        for index, line in enumerate(lines):
            if line and not line.isspace() and not line.startswith("#"):
                run.append(line)
                continue
            yield from self._rows(run, first + index - len(run))
            run = []
            if self._rows_so_far and not line.startswith("#"):
                yield self._close()
        yield from self._rows(run, first + len(lines) - len(run))

    # ------------------------------------------------------------------ the header
    def _header(self, first: int, lines: list[str]) -> tuple[int, list[str]]:
        """Read the columns from the first non-empty line; return the lines after it."""
        for index, line in enumerate(lines):
            if not line.strip() or line.startswith("#"):
                continue
            self.delimiter = next((d for d in (",", ";", "\t") if d in line), None)
            fields = [field.strip() for field in line.split(self.delimiter)]
            if _is_number(fields[0]):
                self.columns = self._without_header(len(fields))
                return first + index, lines[index:]
            self.columns = self._named(fields)
            return first + index + 1, lines[index + 1 :]
        return first, []

    def _without_header(self, count: int) -> tuple[str, ...]:
        if count != len(NEEDED):
            raise DataError(
                f"{self.name}: {count} columns without a header; {','.join(NEEDED)} are needed.",
                f"Give the file a first line that names its columns: {_FORM}",
            )
        return NEEDED

    def _named(self, fields: list[str]) -> tuple[str, ...]:
        columns: list[str] = []
        for field in fields:
            role = role_of(field, FRAMES)
            name = "frame" if role == "view" else role
            if name is None:
                hint = suggestion(plain(field), (*NEEDED, *OPTIONAL)) or f"Columns: {_FORM}"
                raise DataError(f"{self.name}: unknown column '{shown(field)}'.", hint)
            if name in columns:
                first = fields[columns.index(name)]
                raise DataError(
                    f"{self.name}: the columns '{first}' and '{field}' both mean {name}.", f"Columns: {_FORM}"
                )
            columns.append(name)
        missing = [name for name in NEEDED if name not in columns]
        if missing:
            raise DataError(f"{self.name}: the header lacks {' and '.join(missing)}.", f"Columns: {_FORM}")
        return tuple(columns)

    # ------------------------------------------------------------------ the rows
    def _rows(self, lines: list[str], first: int) -> Iterator[Frame]:
        """Process consecutive rows; return the frames that they complete."""
        if not lines:
            return
        table = self._parse(lines, first)
        number = table[:, 0]
        starts = np.flatnonzero(np.diff(number)) + 1
        pieces = np.split(table, starts) if len(starts) else [table]
        for piece in pieces:
            if self._rows_so_far and self._rows_so_far[0][0, 0] != piece[0, 0]:
                yield self._close()
            self._rows_so_far.append(piece)

    def _parse(self, lines: list[str], first: int) -> Array:
        """Numbers (n, 8) in the order frame, X, Y, Z, u, v, sigma, t; absent columns are NaN."""
        width = len(self.columns)
        try:
            if self.delimiter is not None and any(x.count(self.delimiter) != width - 1 for x in lines):
                raise ValueError
            values = np.array(self._joined(lines), float).reshape(-1, width)
            if len(values) != len(lines):
                raise ValueError
        except ValueError:
            values = self._parse_slowly(lines, first)
        table = np.full((len(values), 8), np.nan)
        used = [i for i, name in enumerate(self.columns) if name != UNUSED]
        order = [(*NEEDED, *OPTIONAL).index(self.columns[i]) for i in used]
        table[:, order] = values if len(used) == len(self.columns) else values[:, used]
        self._check(table, lines, first)
        return table

    def _joined(self, lines: list[str]) -> list[str]:
        return (self.delimiter or " ").join(lines).split(self.delimiter)

    def _parse_slowly(self, lines: list[str], first: int) -> Array:
        """Parse row by row: an empty field is NaN, and invalid text is an error with its line."""
        rows = []
        for index, line in enumerate(lines):
            fields = line.split(self.delimiter)
            if len(fields) != len(self.columns):
                raise DataError(
                    f"{self.name}:{first + index}: {len(fields)} fields; "
                    f"{len(self.columns)} ({','.join(self.columns)}) are needed.",
                    "Every row needs a value, or nothing between two commas, for each column.",
                )
            row = []
            for column, field in zip(self.columns, fields, strict=True):
                if field.strip() and not _is_number(field):
                    raise DataError(
                        f"{self.name}:{first + index}: '{shown(field)}' in column {column} is not a number.",
                        "Leave the field empty where the point is missing.",
                    )
                row.append(float(field) if field.strip() else np.nan)
            rows.append(row)
        return np.array(rows)

    def _check(self, table: Array, lines: list[str], first: int) -> None:
        number, sigma = table[:, 0], table[:, 6]
        with np.errstate(invalid="ignore"):
            wrong = {
                "the frame is not a whole number": ~(np.abs(number) < 2.0**53) | (number != np.round(number)),
                "infinite number": np.isinf(table).any(1),
                f"a number above {LARGEST_VALUE:g}": (np.abs(table[:, 1:]) > LARGEST_VALUE).any(1),
                "sigma is not positive": sigma <= 0,
            }
        for what, rows in wrong.items():
            if rows.any():
                index = int(rows.argmax())
                raise DataError(
                    f"{self.name}:{first + index}: {what} ({shown(lines[index])}).", f"Columns: {_FORM}"
                )

    def _close(self) -> Frame:
        """The frame of the rows collected so far, without its missing points."""
        table = self._rows_so_far[0] if len(self._rows_so_far) == 1 else np.concatenate(self._rows_so_far)
        self._rows_so_far = []
        seen = np.isfinite(table[:, 1:6].sum(1))
        time = table[np.isfinite(table[:, 7]), 7]
        points = table if seen.all() else table[seen]
        return Frame(
            int(table[0, 0]),
            points[
                :, 1:4
            ].copy(),  # contiguous: it keeps no block alive and sums in one order wherever it goes
            points[:, 4:6].copy(),
            self._sigma(points[:, 6].copy(), int(table[0, 0])),
            float(time[0]) if len(time) else None,
        )

    def _sigma(self, sigma: Array, number: int) -> Array | None:
        if "sigma" not in self.columns:
            return None
        if np.isnan(sigma).any():
            raise DataError(
                f"{self.name}: frame {number} has points without a sigma.", "Give all points one, or none."
            )
        return sigma


def _is_number(field: str) -> bool:
    try:
        float(field)
    except ValueError:
        return False
    return True
