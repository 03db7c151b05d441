"""stdout and stderr of a run, with any encoding, also if closed or full: text is written, or an error is raised."""

from __future__ import annotations

import contextlib
import io
import os
import sys
from collections.abc import Iterator
from typing import Any, BinaryIO

from camcal.errors import DataError
from camcal.system.text import printable


class Outlet(io.TextIOBase):
    """A stream that accepts any text: characters that it cannot encode, or that control a terminal, are replaced.

    Parameters
    ----------
    stream : text file or None
        None for a stream that was closed before the program began.
    name : str
        "stdout" or "stderr".
    lossy : bool
        Whether text that cannot be written is given up in silence: messages, where there is nowhere to say so.
    raw : bool
        Whether escape sequences pass: those that rich makes for a terminal.

    Raises
    ------
    DataError
        By `write` and `flush`, where the system refuses (a full disk, a closed stream).
    """

    def __init__(self, stream: Any, name: str, lossy: bool = False, raw: bool = False):
        self.stream, self.name, self.lossy, self.raw = stream, name, lossy, raw

    def styled(self) -> Outlet:
        """The same stream for a program that writes its own escape sequences around clean text."""
        return Outlet(self.stream, self.name, self.lossy, raw=True)

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """The encoding of the stream."""
        return getattr(self.stream, "encoding", None) or "utf-8"

    @property
    def errors(self) -> str:  # type: ignore[override]
        """The error handling: nothing is rejected."""
        return "replace"

    def isatty(self) -> bool:
        """Return whether it is a terminal."""
        return self.stream is not None and not self.stream.closed and self.stream.isatty()

    def fileno(self) -> int:
        """Return the file descriptor."""
        if self.stream is None:
            raise io.UnsupportedOperation("fileno")
        return self.stream.fileno()

    def writable(self) -> bool:
        """Return True."""
        return True

    def write(self, text: str) -> int:
        """Write text."""
        if not isinstance(text, str):
            raise TypeError("text is needed")
        shown = text if self.raw else printable(text)
        with self._losses():
            if self.stream is None:
                raise OSError("it is closed")
            self.stream.write(shown.encode(self.encoding, "replace").decode(self.encoding))
        return len(text)

    def flush(self) -> None:
        """Flush the buffer."""
        with self._losses():
            if self.stream is not None:
                self.stream.flush()

    @contextlib.contextmanager
    def _losses(self) -> Iterator[None]:
        try:
            yield
        except BrokenPipeError:
            if not self.lossy:
                raise
        except (OSError, ValueError) as error:  # ValueError: closed meanwhile
            if not self.lossy:
                why = (getattr(error, "strerror", None) or str(error)).lower().rstrip(".")
                raise DataError(
                    f"cannot write to {self.name}: {why}.", "Redirect it elsewhere, or write a file with -o."
                ) from error


@contextlib.contextmanager
def outlets() -> Iterator[None]:
    """Route everything that a run writes to stdout and stderr through outlets."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = Outlet(before[0], "stdout"), Outlet(before[1], "stderr", lossy=True)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before


def standard_input() -> BinaryIO:
    """The bytes of stdin; DataError if it was closed before the program started."""
    if sys.stdin is None:
        raise DataError("stdin is closed; a table is needed there.", "Name a file, or pipe one in.")
    return sys.stdin.buffer


def hold_standard_descriptors() -> None:
    """Open /dev/null in place of closed descriptors 0, 1, 2.

    Otherwise the next file that is opened would be one of them, and a library's warnings would go into a report.
    """
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            # the lowest free number is taken, which is this one
            os.open(os.devnull, os.O_RDONLY if number == 0 else os.O_WRONLY)


def close(*files: Any) -> None:
    """Flush stdout and stderr at the end; after an error of the system nothing more is written."""
    for stream in files:
        try:
            if stream is not None:
                stream.flush()
        except (OSError, ValueError):
            silence(stream)


def silence(stream: Any) -> None:
    """Point a stream at /dev/null, so that the interpreter's final flush does not fail."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        sink = os.open(os.devnull, os.O_WRONLY)
        os.dup2(sink, stream.fileno())
        os.close(sink)
