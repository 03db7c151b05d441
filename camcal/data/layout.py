"""The layout of a table of points: its separator, its header, and its columns."""

from __future__ import annotations

import functools
import re

from camcal.data.blocks import Block
from camcal.data.columns import POINTS, Form, from_header, role_of, without_header
from camcal.errors import DataError
from camcal.records import dataclass

SAMPLE_ROWS = 50  #: rows that decide what the columns are; docs/input-formats.md states the number
_NUMBER = re.compile(
    r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(nan|inf|infinity)", re.ASCII | re.IGNORECASE
)
_QUOTED = re.compile(r'"[^"]*"')
_BLANK_FIELD = re.compile(r'"(?:[^"]|"")*"(?=\s|$)|\S+')


@dataclass(frozen=True)
class Layout:
    """The separator (None for blanks) and the columns; `skip` lines of header precede the rows.

    `header` says whether the file names its columns, `named_points` whether the ids are names.
    """

    separator: str | None
    columns: tuple[str, ...]
    skip: int
    header: bool
    named_points: bool = False

    @property
    def decimal_comma(self) -> bool:
        """Whether numbers have a decimal comma."""
        return self.separator in (";", "\t")

    def split(self, line: str) -> list[str]:
        """The fields of a line, without quotes and surrounding blanks."""
        return split(line, self.separator)

    def is_number(self, text: str) -> bool:
        """Return whether a field is a number, including NaN and infinity."""
        return is_number(text, self.separator)


def split(line: str, separator: str | None) -> list[str]:
    """Split a line at a separator, None for blanks; double quotes protect a field."""
    if '"' not in line:
        return [part.strip() for part in line.split(separator)]
    if separator is None:
        return [_unquoted(m[0]) for m in _BLANK_FIELD.finditer(line)]
    fields = []
    for match in _field(separator).finditer(line):
        fields.append(_unquoted(match[1].strip()))
        if not match[2]:  # the end of the line; what follows is the empty match there
            break
    return fields


@functools.cache
def _field(separator: str) -> re.Pattern[str]:
    return re.compile(rf'[ \t]*("(?:[^"]|"")*"[ \t]*|[^{separator}]*)({separator}|$)')


def _unquoted(field: str) -> str:
    quoted = len(field) > 1 and field[0] == field[-1] == '"'
    return field[1:-1].replace('""', '"') if quoted else field


def is_number(text: str, separator: str | None) -> bool:
    """Return whether a field is a number; with `;` or tab as separator a comma is the decimal point."""
    if separator in (";", "\t"):
        text = text.replace(",", ".")
    return _NUMBER.fullmatch(text.strip()) is not None


def find_layout(block: Block, form: Form, path: str) -> Layout:
    """Find the layout of a table from the first lines of its first block.

    The first row is a header where none of its fields is a number. A table of 3D or of image points alone may
    have several rows of header. The last comment before a table without a header counts as its header where
    it names the right number of known columns (`numpy.savetxt` writes such files).

    Raises
    ------
    DataError
        As `columns.from_header` and `columns.without_header`.
    """
    lines = block.lines[:SAMPLE_ROWS]
    separator = find_separator(_first_row(lines) if form is not POINTS else lines[0])
    rows = [split(line, separator) for line in lines]
    where = f"{path}:{block.numbers[0]}"
    if form is POINTS and not any(is_number(f, separator) for f in rows[0]):
        named = from_header(rows[0], form, where)
        ids = "id" in named and _names_points(named, _numeric(rows[1:], separator))
        return Layout(separator, named, 1, True, ids)
    numeric = _numeric(rows, separator)
    if form is POINTS:
        skip, columns = 0, None
    else:
        skip, columns = _skip_header(rows, numeric, form)
        if skip == len(rows):
            raise DataError(f"{path}: the file has a header but no rows of numbers.", "Is it the right file?")
    columns = columns or _commented_header(block.comments, len(rows[skip]), form)
    header = columns is not None
    if columns is None:
        texts_first = [not any(n[:1]) for n in numeric]
        first = [not all(texts_first)] + numeric[skip][1:]
        columns = without_header(rows[skip], first, form, f"{path}:{block.numbers[skip]}")
    return Layout(separator, columns, skip, header, _names_points(columns, numeric[skip:]))


def _numeric(rows: list[list[str]], separator: str | None) -> list[list[bool]]:
    """Which fields of each row are numbers."""
    return [[is_number(f, separator) for f in row] for row in rows]


def _names_points(columns: tuple[str, ...], numeric: list[list[bool]]) -> bool:
    """Return whether the ids of the first rows are names: P1, P2."""
    if "id" not in columns:
        return False
    at = columns.index("id")
    return bool(numeric) and not any(row[at] for row in numeric if len(row) == len(columns))


def find_separator(line: str) -> str | None:
    """Return `;`, tab or `,`, whichever comes first in that order outside quotes, or None for blanks."""
    bare = _QUOTED.sub("quoted", line)
    if ";" in bare:
        return ";"
    if "\t" in bare.strip() and all(part.strip() for part in bare.split("\t")):
        return "\t"
    return "," if "," in bare else None


def _first_row(lines: list[str]) -> str:
    """The first line that starts with a number, otherwise the first line."""
    return next((x for x in lines if re.match(r"\s*[-+.]?\d", x)), lines[0])


def _skip_header(
    rows: list[list[str]], numeric: list[list[bool]], form: Form
) -> tuple[int, tuple[str, ...] | None]:
    """The number of header rows, and the columns if one of these rows names them all."""
    columns: tuple[str, ...] | None = None
    for index, (row, is_num) in enumerate(zip(rows, numeric, strict=True)):
        like_data = len(row) in form.headless and 2 * sum(is_num) >= len(row)  # perhaps with one wrong field
        if any(is_num) and (columns or is_num[0] or like_data):
            return index, columns
        if columns is None:
            columns = _known(row, form)
    return len(rows), columns


def _commented_header(comments: tuple[str, ...], count: int, form: Form) -> tuple[str, ...] | None:
    if not comments:
        return None
    text = comments[-1].lstrip("#%").strip()
    names = split(text, find_separator(text))
    return _known(names, form) if len(names) == count else None


def _known(names: list[str], form: Form) -> tuple[str, ...] | None:
    """The columns if all names are known, distinct and sufficient; None otherwise."""
    roles = [role_of(name, form) for name in names]
    if None in roles or len(set(roles)) < len(roles) or not set(form.needed) <= set(roles):
        return None
    return tuple(r for r in roles if r)
