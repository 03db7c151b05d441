"""Text output: escaping of what a terminal, a spreadsheet or a file's encoding would interpret.

Names come from file names and tables of strangers. A terminal obeys control characters in them (ECMA-48), a
right-to-left override hides the end of a name (Unicode TR 36, 2.5), and a spreadsheet runs a cell that begins
with `= + - @` as a formula.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

#: control characters except line end and tab: C0, DEL, C1 (ECMA-48), and Unicode's controls of direction and lines
UNSAFE = "\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028\u2029\u202a-\u202e\u2066-\u2069"
_UNSAFE = re.compile(f"[{UNSAFE}]")
_FORMULA = re.compile(r"'*[=+\-@\t\r]")
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|[-+]?(nan|inf)", re.IGNORECASE)
LONGEST_WORD = 300  #: characters of one word of a message; longer than a path that somebody would type
LONGEST_VALUE = (
    60  #: characters of a value quoted in a message; half a line, so that the rest of the sentence fits
)
LONGEST_MESSAGE = 2000  #: characters; a screen of text


def readable(text: str) -> str:
    r"""The text in valid UTF-8: invalid bytes of a file name become `\xe9`."""
    if text.isascii():
        return text
    try:
        text.encode("utf-8")
    except UnicodeEncodeError as error:
        # U+DC80 to U+DCFF stand for bytes of a file's name; JSON can hold other halves of a pair
        halves = all("\udc80" <= c <= "\udcff" for c in text if "\ud800" <= c <= "\udfff")
        data = text.encode(error.encoding, "surrogateescape" if halves else "backslashreplace")
        return data.decode("utf-8", "backslashreplace")
    return text


def printable(text: str) -> str:
    """The text without terminal control characters; each is replaced by one character of the same width."""
    return _UNSAFE.sub("\ufffd", readable(text))


def escaped(text: str) -> str:
    r"""The text of a JSON document, or of YAML with quoted strings, with such characters as `\u202e`."""
    return _UNSAFE.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


def has_unsafe(text: str) -> bool:
    """Return whether the text contains terminal control characters."""
    return _UNSAFE.search(text) is not None


def listed(parts: Sequence[str], most: int = 5) -> str:
    """The first few items of a list, and the number of the others."""
    more = len(parts) - most
    return ", ".join(parts[:most]) + (f" and {more} more" if more > 0 else "")


def counted(n: int, noun: str) -> str:
    """`1 view`, `2 views`."""
    return f"{n} {noun}{'' if n == 1 else 's'}"


def quoted(value: object) -> str:
    """A value as messages quote it: text in quotation marks, `true` and `false` as in YAML, cut where it is long."""
    text = str(value).lower() if isinstance(value, bool) else str(value)
    text = text if len(text) <= LONGEST_VALUE else f"{text[: LONGEST_VALUE - 3]}..."
    return f"'{text}'" if isinstance(value, str) else text


def message(text: str) -> str:
    """A message on one line; long words and long texts are shortened in the middle."""
    text = " ".join(printable(text).split())
    text = re.sub(rf"\S{{{LONGEST_WORD},}}", lambda found: _without_middle(found[0], LONGEST_WORD), text)
    return _without_middle(text, LONGEST_MESSAGE)


def _without_middle(text: str, longest: int) -> str:
    return text if len(text) <= longest else f"{text[: longest // 2]}...{text[-longest // 4 :]}"


def cell(name: str) -> str:
    """A name as a cell of a table: an apostrophe before what a spreadsheet would run as a formula."""
    return "'" + name if _FORMULA.match(name) and not _NUMBER.fullmatch(name) else name


def from_cell(name: str) -> str:
    """The name from which `cell` made a cell."""
    return name[1:] if name[:1] == "'" and cell(name[1:]) == name else name
