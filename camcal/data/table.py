"""A text table of points as arrays: C code parses blocks of lines, Python only a block that fails."""

from __future__ import annotations

import contextlib
from dataclasses import replace
from itertools import repeat
from typing import NoReturn

import msgspec
import numpy as np

from camcal.data.blocks import Block, TextFile, without_last_separator
from camcal.data.columns import POINTS, Form, shown
from camcal.data.layout import Layout, find_layout
from camcal.errors import DataError
from camcal.records import dataclass
from camcal.system.text import from_cell

Array = np.ndarray
#: coordinates above it are refused: their fourth powers, as in the products of a DLT, have to fit in float64
LARGEST_VALUE = 1e70
LARGEST_ID = 2**53  #: whole numbers up to here are exact as float64
#: of the numbers that JSON has; correctly rounded, as np.loadtxt, in a quarter of its time
_NUMBERS = msgspec.json.Decoder(list[float])


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
        For `where`; one entry per block; empty for an archive.
    header : bool
        Whether the file names its columns.
    shape : tuple of int
        Of the rows in an archive: (N,) or (V, N).
    """

    path: str
    sha256: str
    columns: tuple[str, ...]
    values: Array
    view_names: tuple[str, ...]
    view_index: Array | None
    line_starts: tuple[tuple[int, range | Array], ...] = ()
    header: bool = True
    shape: tuple[int, ...] = ()

    def column(self, name: str) -> Array | None:
        """Return the column (N,), or None if the table has none of that name."""
        return self.values[:, self.columns.index(name)] if name in self.columns else None

    def where(self, row: int) -> str:
        """The file and the position of a row in it, for messages."""
        return f"{self.path}:{self.row_name(row).removeprefix('line ')}"

    def row_name(self, row: int) -> str:
        """The position of a row: `line 7`, or `row [6]` of an archive's arrays, from 0."""
        if not self.line_starts:
            return f"row {[int(i) for i in np.unravel_index(row, self.shape)]}"
        start, numbers = next(entry for entry in reversed(self.line_starts) if entry[0] <= row)
        return f"line {numbers[row - start]}"


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
    points: dict[str, int] = {}
    values, index, starts, rows = [], [], [], 0
    for block in source.blocks():
        block = without_last_separator(block)
        if layout is None:
            layout = find_layout(block, form, path)
            block = block.after(layout.skip)
            if not block.lines:
                continue
        if layout.named_points:
            block = _numbered(block, layout, points)
        numbers, views = _parse(block, layout, path)
        values.append(numbers)
        starts.append((rows, block.numbers))
        rows += len(numbers)
        if views:
            plain = str if block.quoted else str.strip  # blanks in quotes belong to the name
            raw = {
                view: names.setdefault(from_cell(plain(view)), len(names)) for view in dict.fromkeys(views)
            }
            index.append(np.fromiter(map(raw.__getitem__, views), np.int32, len(views)))
    if layout is None or not values:
        found = "only comments and blank lines" if layout is None else "a header but no rows"
        raise DataError(f"{path}: {found}; points are needed.", "Is it the right file?")
    columns = tuple(c for c in layout.columns if c != "view")
    joined = np.concatenate(index) if index else None
    return Table(
        path,
        source.sha256,
        columns,
        np.concatenate(values),
        tuple(names),
        joined,
        tuple(starts),
        layout.header,
    )


def _numbered(block: Block, layout: Layout, points: dict[str, int]) -> Block:
    """The block with a number for each point name, counted from 0 in order of appearance."""
    at, lines = layout.columns.index("id"), []
    for line in block.lines:
        fields = layout.split(line)
        if len(fields) == len(layout.columns) and fields[at]:
            fields[at] = str(points.setdefault(fields[at], len(points)))
        if block.quoted:
            fields = ['"' + f.replace('"', '""') + '"' for f in fields]
        lines.append((layout.separator or " ").join(fields))
    return replace(block, lines=lines)


def _parse(block: Block, layout: Layout, path: str) -> tuple[Array, list[str] | None]:
    """The numbers (n, C) and the views of the rows of a block."""
    place = layout.columns.index("view") if "view" in layout.columns else None
    columns = [c for c in layout.columns if c != "view"]
    try:
        split = _split_fields if block.quoted else _split_lines
        numbers, views = split(block.lines, layout, place)
    except ValueError:
        _diagnose(block, layout, path)
    good = (np.abs(numbers) <= LARGEST_VALUE).all() and (
        views is None or all(map(str.strip, dict.fromkeys(views)))
    )
    if "sigma" in columns:
        good = good and (numbers[:, columns.index("sigma")] > 0).all()
    if "id" in columns:
        good = good and is_id(numbers[:, columns.index("id")]).all()
    if not good:
        _diagnose(block, layout, path)
    return numbers, views


def is_id(values: Array) -> Array:
    """Return where values are whole numbers that float64 represents exactly."""
    return (np.rint(values) == values) & (np.abs(values) <= LARGEST_ID)


def _split_lines(lines: list[str], layout: Layout, place: int | None) -> tuple[Array, list[str] | None]:
    """Numbers and views of lines without quotes. Raises ValueError if a line is malformed."""
    separator, width = layout.separator, len(layout.columns)
    if separator is None:
        widths = set(map(len, map(str.split, lines)))
    else:
        widths = {n + 1 for n in set(map(str.count, lines, repeat(separator)))}
    if widths != {width}:  # loadtxt itself does not mind long rows where columns are picked
        raise ValueError(widths)
    views, bare = None, lines if place is None else None
    if place == 0 and separator is not None:
        parts = zip(*map(str.partition, lines, repeat(separator)), strict=True)
        views, _, bare = map(list, parts)
    elif place is not None:
        views = [line.split(separator, place + 1)[place] for line in lines]
    if separator == "," and bare is not None:
        with contextlib.suppress(
            msgspec.MsgspecError
        ):  # nan, +1, .5, 1., 007 are numbers, though not of JSON
            return np.array(_NUMBERS.decode(f"[{','.join(bare)}]")).reshape(len(lines), -1), views
    if layout.decimal_comma:
        lines = [line.replace(",", ".") for line in lines]
    picked = [i for i in range(width) if i != place]
    return np.loadtxt(lines, delimiter=separator, comments=None, ndmin=2, usecols=picked), views


def _split_fields(lines: list[str], layout: Layout, place: int | None) -> tuple[Array, list[str] | None]:
    """As `_split_lines` for lines with quotes, field by field."""
    rows = [layout.split(line) for line in lines]
    if any(len(row) != len(layout.columns) for row in rows):
        raise ValueError
    views = None if place is None else [row.pop(place) for row in rows]
    bare = replace(layout, separator=";" if layout.decimal_comma else ",", columns=("X",) * len(rows[0]))
    return _split_lines([str(bare.separator).join(row) for row in rows], bare, None)[0], views


def _diagnose(block: Block, layout: Layout, path: str) -> NoReturn:
    """Find the first malformed line of a block, and describe the error."""
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
    raise DataError(f"{path}: {lines} do not read as numbers.", "Look for unusual characters in them.")


def _check_field(field: str, role: str, layout: Layout, where: str) -> None:
    if role == "view":
        if not field.strip():
            raise DataError(f"{where}: the view is empty; a name is needed.", "Fill in the view.")
        return
    if not layout.is_number(field):
        found = f"'{shown(field)}' is not a number" if field else "an empty field"
        raise DataError(f"{where}: {role}: {found}; a number is needed.", "Correct or remove that row.")
    value = float(field.replace(",", ".") if layout.decimal_comma else field)
    if not np.isfinite(value):
        raise DataError(
            f"{where}: {role} is {shown(field)}; a finite number is needed.",
            "Remove that row.",
        )
    if abs(value) > LARGEST_VALUE:
        raise DataError(
            f"{where}: {role} is {shown(field)}; a number below {LARGEST_VALUE:g} is needed.",
            "Is it damaged?",
        )
    if role == "sigma" and value <= 0:
        raise DataError(
            f"{where}: sigma is {shown(field)}; a number above 0 is needed.",
            "sigma is the standard deviation of u and of v, px; leave the column out if it is not known.",
        )
    if role == "id" and not is_id(np.array(value)):
        raise DataError(f"{where}: id is {shown(field)}; a whole number is needed.", "Number the points.")
