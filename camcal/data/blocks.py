"""A text file as blocks of whole lines, with line numbers and a running checksum.

Memory stays at the size of a block however long the file is.
"""

from __future__ import annotations

import codecs
import hashlib
import io
import re
from collections.abc import Callable, Iterator
from dataclasses import field, replace
from pathlib import Path

import numpy as np

from camcal.errors import DataError
from camcal.records import dataclass

BLOCK_BYTES = 1 << 21  #: 2 MB: what is in work stays small beside the points themselves
LONGEST_LINE = 1 << 20  #: more than this in one line is not a table of points
_COMMENT = re.compile(r'("[^"\n]*")|((?:^|(?<=[ \t]))#[^\n]*|^[ \t]*%[^\n]*)', re.MULTILINE)
_TEXT_HINT = "Give a CSV or text table of points, or an .npz file."


@dataclass(frozen=True)
class Block:
    """Consecutive lines of a file without its comments and blank lines.

    Attributes
    ----------
    lines : list of str
    numbers : range or (n,) int array
        The line number of each.
    quoted : bool
        Whether they may contain a double quote.
    comments : tuple of str
        Of a file's first block, those before its first line: a header may stand there.
    """

    lines: list[str]
    numbers: range | np.ndarray
    quoted: bool
    comments: tuple[str, ...] = ()

    def after(self, count: int) -> Block:
        """Return the block without its first `count` lines."""
        return Block(self.lines[count:], self.numbers[count:], self.quoted)


@dataclass
class TextFile:
    """A file being read; `sha256` is complete once `blocks` has run to its end."""

    path: str
    sha256: str = field(default="", init=False)

    def blocks(self, size: int = BLOCK_BYTES) -> Iterator[Block]:
        """Yield the lines of the file.

        Raises
        ------
        DataError
            If the file is missing, unreadable, empty, binary, or not UTF-8.
        """
        digest = hashlib.sha256()
        first = 1
        for text in self._whole_lines(size, digest.update):
            block, count = _block(text, first)
            first += count
            if block.lines:
                yield block
        self.sha256 = digest.hexdigest()

    def _whole_lines(self, size: int, update: Callable[[bytes], object]) -> Iterator[str]:
        decoder = io.IncrementalNewlineDecoder(codecs.getincrementaldecoder("utf-8-sig")(), translate=True)
        rest, seen, done = "", 0, False
        with open_binary(self.path) as stream:
            while not done:
                data = read_bytes(stream, size, self.path)
                done = not data
                update(data)
                self._check_text(data, seen)
                text = rest + self._decode(decoder, data, seen, done)
                seen += len(data)
                end = len(text) if done else text.rfind("\n") + 1
                text, rest = text[:end], text[end:]
                if len(rest) > LONGEST_LINE:
                    raise DataError(
                        f"{self.path}: a line has more than {LONGEST_LINE} characters.", _TEXT_HINT
                    )
                if text:
                    yield text
        if not seen:
            raise DataError(f"{self.path}: the file is empty (0 bytes).", _TEXT_HINT)

    def _check_text(self, data: bytes, seen: int) -> None:
        if not seen and data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            raise DataError(
                f"{self.path}: the text is UTF-16; UTF-8 is needed.", "Save it as UTF-8 or as CSV."
            )
        if b"\0" in data:
            raise DataError(
                f"{self.path}: a binary file (zero byte at {seen + data.index(0)}); text is needed.",
                _TEXT_HINT,
            )

    def _decode(self, decoder: io.IncrementalNewlineDecoder, data: bytes, seen: int, final: bool) -> str:
        try:
            return decoder.decode(data, final)  # type: ignore[arg-type]  # the wrapped decoder takes bytes
        except UnicodeDecodeError as error:
            found = error.object[error.start]
            raise DataError(
                f"{self.path}: byte 0x{found:02x} near position {seen + error.start} is not UTF-8 text.",
                "Save the file as UTF-8. " + _TEXT_HINT,
            ) from None


def open_binary(path: str) -> io.BufferedReader:
    """Open a file for reading; a `DataError` if that fails."""
    if Path(path).is_dir():
        raise DataError(f"{path}: a folder; a file of points is needed.", "Name the files in it.")
    try:
        return Path(path).open("rb")
    except FileNotFoundError:
        raise DataError(f"{path}: no such file.", "Check the name and the folder.") from None
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
        raise DataError(f"{path!r} cannot be read: {error}.", "Check the name and the permissions.") from None


def read_bytes(stream: io.BufferedReader, size: int, path: str) -> bytes:
    """Read up to `size` bytes (all with -1); a `DataError` if the system reports an error."""
    try:
        return stream.read(size)
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error}.", "Check the permissions and the disk.") from None


def without_last_separator(block: Block) -> Block:
    """Return the block without the trailing separator that some programs write on every line."""
    ending = block.lines[0].rstrip()[-1:]
    if ending not in (",", ";") or block.quoted or not all(x.rstrip().endswith(ending) for x in block.lines):
        return block
    return replace(block, lines=[x.rstrip()[:-1] for x in block.lines])


def _block(text: str, first: int) -> tuple[Block, int]:
    """The block of a text that starts at line `first`, and its number of lines."""
    raw = text.split("\n")
    if not raw[-1]:
        raw.pop()
    lines = raw
    if "#" in text or "%" in text:  # MATLAB's comments take a whole line
        lines = _COMMENT.sub(lambda m: m[1] or "", text).split("\n")[: len(raw)]
    quoted = '"' in text
    if all(lines) and not any(map(str.isspace, lines)):
        return Block(lines, range(first, first + len(raw)), quoted), len(raw)
    keep = [i for i, line in enumerate(lines) if line and not line.isspace()]
    before = raw[: keep[0]] if keep else []
    comments = (
        tuple(line.strip() for line in before if line.lstrip().startswith(("#", "%"))) if first == 1 else ()
    )
    numbers = np.array(keep, dtype=np.int64) + first
    return Block([lines[i] for i in keep], numbers, quoted, comments), len(raw)
