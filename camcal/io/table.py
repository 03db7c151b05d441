"""A text table of points to arrays: C code parses blocks of lines, Python only a block that fails."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import repeat
from typing import NoReturn

import numpy as np

from camcal.errors import DataError
from camcal.io.blocks import Block, TextFile
from camcal.io.columns import POINTS, Form
from camcal.io.layout import Layout, find_layout

Array = np.ndarray
LARGEST_ID = 2**53  #: whole numbers up to here are exact as float64


@dataclass(frozen=True)
class Table:
    """The rows of a file of points.

    Attributes
    ----------
    path : str
    sha256 : str
    columns : tuple of str
        What the columns of `values` are; the view is not among them.
    values : (N, C) array
    view_names : tuple of str
        In the order of first appearance; empty where there is no view column.
    view_index : (N,) int array or None
        Which name each row has.
    line_starts : tuple of (first row, line numbers)
        For `line_of`; one entry per block.
    """

    path: str
    sha256: str
    columns: tuple[str, ...]
    values: Array
    view_names: tuple[str, ...]
    view_index: Array | None
    line_starts: tuple[tuple[int, Sequence[int]], ...]

    def column(self, name: str) -> Array | None:
        """Return the column (N,), or None where the table has none of that name."""
        return self.values[:, self.columns.index(name)] if name in self.columns else None

    def line_of(self, row: int) -> int:
        """The line number of a row in the file."""
        start, numbers = next(entry for entry in reversed(self.line_starts) if entry[0] <= row)
        return numbers[row - start]


def read_table(path: str, form: Form = POINTS) -> Table:
    """Read a text table.

    Raises
    ------
    DataError
        With file and line, where anything in the file is not what `form` needs.
    """
    source = TextFile(path)
    layout: Layout | None = None
    names: dict[str, int] = {}
    values, index, starts, rows = [], [], [], 0
    for block in source.blocks():
        if layout is None:
            layout = find_layout(block, form, path)
            block = block.after(layout.skip)
            if not block.lines:
                continue
        numbers, views = _parse(block, layout, path)
        values.append(numbers)
        starts.append((rows, block.numbers))
        rows += len(numbers)
        if views:
            for name in dict.fromkeys(views):
                names.setdefault(name, len(names))
            index.append(np.fromiter(map(names.__getitem__, views), np.int32, len(views)))
    if layout is None or not values:
        found = "only comments and blank lines" if layout is None else "a header but no rows"
        raise DataError(f"{path}: {found}; points are needed.", "Is it the right file?")
    columns = tuple(c for c in layout.columns if c != "view")
    joined = np.concatenate(index) if index else None
    return Table(path, source.sha256, columns, np.concatenate(values), tuple(names), joined, tuple(starts))


def _parse(block: Block, layout: Layout, path: str) -> tuple[Array, list[str] | None]:
    """The numbers (n, C) and the views of the rows of a block."""
    texts, views, separator = _without_view(block, layout)
    columns = [c for c in layout.columns if c != "view"]
    try:
        numbers = np.loadtxt(texts, delimiter=separator, comments=None, ndmin=2)
    except ValueError:
        _diagnose(block, layout, path)
    if numbers.shape != (len(block.lines), len(columns)) or not np.isfinite(numbers).all():
        _diagnose(block, layout, path)
    if views and not all(views):
        _diagnose(block, layout, path)
    for role, ok in (("sigma", lambda a: a > 0), ("id", is_id)):
        if role in columns and not np.all(ok(numbers[:, columns.index(role)])):
            _diagnose(block, layout, path)
    return numbers, views


def is_id(values: Array) -> Array:
    """Where values are whole numbers that float64 holds exactly."""
    return (np.rint(values) == values) & (np.abs(values) <= LARGEST_ID)


def _without_view(block: Block, layout: Layout) -> tuple[list[str], list[str] | None, str | None]:
    """The lines without their view, the views, and the separator of the lines returned."""
    lines, separator = block.lines, layout.separator
    place = layout.columns.index("view") if "view" in layout.columns else None
    last = len(layout.columns) - 1
    quoted = any(map(str.__contains__, lines, repeat('"')))
    if quoted or place not in (None, 0, last):
        return _split_all(block, layout, place)
    views: list[str] | None = None
    if place is not None and last:
        cut = str.split if place == 0 else str.rsplit
        pairs = [p if len(p) == 2 else (["", ""]) for p in map(cut, lines, repeat(separator), repeat(1))]
        views = [p[0 if place == 0 else 1].strip() for p in pairs]
        lines = [p[1 if place == 0 else 0] for p in pairs]
    if layout.decimal_comma:
        lines = [line.replace(",", ".") for line in lines]
    return lines, views, separator


def _split_all(
    block: Block, layout: Layout, place: int | None
) -> tuple[list[str], list[str] | None, str | None]:
    """As `_without_view`, field by field, for quoted fields and a view in the midst."""
    rows = [layout.split(line) for line in block.lines]
    views = None
    if place is not None:
        views = [row.pop(place) if place < len(row) else "" for row in rows]
    if layout.decimal_comma:
        rows = [[field.replace(",", ".") for field in row] for row in rows]
    return [",".join(row) for row in rows], views, ","


def _diagnose(block: Block, layout: Layout, path: str) -> NoReturn:
    """Find the first line of a block that is wrong, and say what is."""
    for line, number in zip(block.lines, block.numbers, strict=True):
        fields = layout.split(line)
        where = f"{path}:{number}"
        if len(fields) != len(layout.columns):
            needed = ",".join(layout.columns)
            raise DataError(
                f"{where}: {len(fields)} field{'s' * (len(fields) != 1)} found; {needed} are needed.",
                "Each row needs all columns; a name with separators in it needs double quotes.",
            )
        for field, role in zip(fields, layout.columns, strict=True):
            _check_field(field, role, layout, where)
    lines = f"lines {block.numbers[0]} to {block.numbers[-1]}"
    raise DataError(f"{path}: {lines} do not read as numbers.", "Look for unusual signs in them.")


def _check_field(field: str, role: str, layout: Layout, where: str) -> None:
    if role == "view":
        if not field:
            raise DataError(f"{where}: the view is empty; a name is needed.", "Fill in the view.")
        return
    if not layout.is_number(field):
        found = f"'{_short(field)}' is not a number" if field else "an empty field"
        raise DataError(f"{where}: {role}: {found}; a number is needed.", "Correct or remove that row.")
    value = float(field.replace(",", ".") if layout.decimal_comma else field)
    if not np.isfinite(value):
        raise DataError(
            f"{where}: {role} is {_short(field)}; a finite number is needed.",
            "Remove that row.",
        )
    if role == "sigma" and value <= 0:
        raise DataError(
            f"{where}: sigma is {_short(field)}; a number above 0 is needed.",
            "sigma is the standard deviation of u and of v, px; leave the column out where it is not known.",
        )
    if role == "id" and not is_id(np.array(value)):
        raise DataError(f"{where}: id is {_short(field)}; a whole number is needed.", "Number the points.")


def _short(text: str) -> str:
    return text if len(text) <= 40 else text[:37] + "..."
