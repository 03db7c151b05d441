"""Tables with names in some columns and numbers in others: tracks, lines, points of several cameras."""

from __future__ import annotations

import csv
import io
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from camcal.data.columns import plain
from camcal.data.dltdv import as_long, is_xypts
from camcal.data.layout import find_separator, is_number
from camcal.errors import DataError
from camcal.records import dataclass
from camcal.system.documents import LARGEST
from camcal.system.reading import read_text
from camcal.system.text import from_cell

Array = np.ndarray

#: other names of the columns, compared without case, blanks and signs
ALIASES = {
    "camera": "cam",
    "view": "image img frame file picture",
    "point": "id pointid track trackid marker name",
    "line": "lineid segment string",
    "u": "x px col column",
    "v": "y py row",
    "sigma": "std stddev",
}


@dataclass(frozen=True)
class Labelled:
    """The rows of a table.

    Attributes
    ----------
    path : str
    labels : mapping of column -> (N,) int array
        Which of `names[column]` a row has.
    names : mapping of column -> tuple of str
        In the order of first appearance.
    values : mapping of column -> (N,) array
    rows : (N,) int array
        Line of the file, from 1.
    """

    path: str
    labels: Mapping[str, Array]
    names: Mapping[str, tuple[str, ...]]
    values: Mapping[str, Array]
    rows: Array

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def uv(self) -> Array:
        """The image points (N, 2), px."""
        return np.stack([self.values["u"], self.values["v"]], 1)


def read_labelled(
    path: str | os.PathLike,
    text: Sequence[str],
    numbers: Sequence[str] = ("u", "v"),
    optional: Sequence[str] = (),
) -> Labelled:
    """Read a table whose first row names its columns.

    Parameters
    ----------
    text, numbers : sequences of str
        Columns that must be there.
    optional : sequence of str
        Columns that may be there: `sigma` holds numbers, any other names.

    Raises
    ------
    DataError
        If the file is missing or no text, a column is missing or there twice, or a field is no number.
    """
    source = Path(path)
    lines = _lines(source)
    separator = find_separator(lines[0][1]) or " "
    rows = [(n, _fields(line, separator)) for n, line in lines]
    if is_xypts(rows[0][1]):
        rows = as_long(rows)
    columns = _columns(rows[0][1], [*text, *numbers], [*text, *numbers, *optional], f"{source}:{rows[0][0]}")
    names = [c for c in columns if c not in numbers and c != "sigma"]
    found: dict[str, list] = {c: [] for c in columns}
    for number, fields in rows[1:]:
        where = f"{source}:{number}"
        if len(fields) < len(rows[0][1]):
            raise DataError(
                f"{where}: {len(fields)} fields found; {len(rows[0][1])} are needed.", "Complete the row."
            )
        for column, at in columns.items():
            value = fields[at].strip()
            found[column].append(
                from_cell(value) if column in names else _number(value, separator, column, where)
            )
    labels, known = {}, {}
    for column in names:
        order: dict[str, int] = {}
        labels[column] = np.array([order.setdefault(v, len(order)) for v in found[column]], int)
        known[column] = tuple(order)
    values = {c: np.array(found[c], float) for c in columns if c not in names}
    return Labelled(str(source), labels, known, values, np.array([n for n, _ in rows[1:]]))


def header(path: str | os.PathLike) -> list[str]:
    """The names in the first row of a table; raises as `read_labelled` does."""
    first = _lines(Path(path))[0][1]
    return [name.strip() for name in _fields(first, find_separator(first) or " ")]


def _lines(source: Path) -> list[tuple[int, str]]:
    """The non-empty lines, numbered from 1."""
    text = read_text(source, LARGEST, "a text table", "Give a CSV file.")
    lines = [(n, line) for n, line in enumerate(text.splitlines(), 1) if line.strip() and line[0] != "#"]
    if len(lines) < 2:
        raise DataError(
            f"'{source}' holds no rows; a header and rows of points are needed.", "Is it the right file?"
        )
    return lines


def _fields(line: str, separator: str) -> list[str]:
    return line.split() if separator == " " else next(csv.reader(io.StringIO(line), delimiter=separator))


def _columns(
    header: Sequence[str], needed: Sequence[str], known: Sequence[str], where: str
) -> dict[str, int]:
    """The position of each known column."""
    by_name = {alias: c for c in known for alias in ALIASES.get(c, "").split()}
    by_name |= {
        plain(c): c for c in known
    }  # a column's own name wins: X is not another name of u beside X, Y, Z
    found: dict[str, int] = {}
    for index, name in enumerate(header):
        column = by_name.get(plain(name))
        if column in found:
            raise DataError(f"{where}: two columns mean {column}; one is needed.", "Rename one of them.")
        if column is not None:
            found[column] = index
    missing = [c for c in needed if c not in found]
    if missing:
        raise DataError(
            f"{where}: the header ({', '.join(header)}) lacks {' and '.join(missing)}.",
            "Name the columns " + ",".join(known) + ".",
        )
    return found


def _number(value: str, separator: str, column: str, where: str) -> float:
    if not is_number(value, separator):
        raise DataError(f"{where}: {column}: '{value}' is not a number.", "Correct or remove that row.")
    number = float(value.replace(",", ".") if separator in (";", "\t") else value)
    if not math.isfinite(number) or (column == "sigma" and number <= 0):
        needed = "a number above 0" if column == "sigma" else "a finite number"
        raise DataError(f"{where}: {column} is {value}; {needed} is needed.", "Correct or remove that row.")
    return number
