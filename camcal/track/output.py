"""Where the rows go: a file that appears when it is complete, one that grows, or stdout."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import IO

from camcal.data.writing import is_special
from camcal.errors import UsageError
from camcal.track.base import State
from camcal.track.table import Table


class Output:
    """Collects states and writes their rows, some at a time.

    Parameters
    ----------
    table : Table
    format : {"csv", "jsonl"}
    path : Path or None
        None: stdout.
    growing : bool
        Whether the file is written in place as rows come: for pipes and for runs that may be taken up again.
        Otherwise it is written beside and takes its name when it is complete.
    block : int
        Rows that are turned into text at once.
    """

    def __init__(
        self,
        table: Table,
        format: str = "csv",
        path: Path | None = None,
        growing: bool = False,
        block: int = 256,
    ):
        self.table, self.format, self.path, self.block = table, format, path, block
        if path is None or growing or is_special(path):  # a device or a pipe is never replaced
            self.part = path
        else:
            self.path = path = path.resolve()  # a symbolic link stays; its target is replaced
            self.part = path.with_name(f".{path.name}.{os.getpid()}.part")
        self._stream: IO[str] | None = None
        self._states: list[State] = []
        self._begun = False

    def add(self, state: State) -> None:
        """Take a state; its row is written with the block it belongs to."""
        self._states.append(state)
        if len(self._states) >= self.block:
            self.flush()

    def flush(self) -> int:
        """Write what there is; the number of bytes in the file so far, 0 for stdout, devices and pipes."""
        stream = self._open()
        if self._states:
            text = self.table.csv(self._states) if self.format == "csv" else self.table.jsonl(self._states)
            stream.write(text)
            self._states = []
        stream.flush()
        return 0 if self.part is None or is_special(self.part) else stream.tell()

    def _open(self) -> IO[str]:
        if self._stream is None:
            if self.part is None:
                self._stream = sys.stdout
            else:
                self._stream = self.part.open("w", encoding="utf-8", newline="")
        if not self._begun:
            self._begun = True
            if self.format == "csv":
                self._stream.write(self.table.header)
        return self._stream

    def resume(self, size: int) -> None:
        """Go on with a file of which the first `size` bytes count; with stdout, a device or a pipe, go on
        without a header.

        Raises
        ------
        UsageError
            Where the file is missing or shorter.
        """
        self._begun = True
        if self.part is None or is_special(self.part):
            return
        found = self.part.stat().st_size if self.part.is_file() else 0
        if found < size:
            raise UsageError(
                f"{self.part}: {found} bytes found; the state belongs to a table of at least {size}.",
                "Give the table that the state was made with, or begin anew with another --state.",
            )
        self._stream = self.part.open("r+", encoding="utf-8", newline="")
        self._stream.truncate(size)
        self._stream.seek(size)

    def finish(self) -> None:
        """Close the file; it takes its name."""
        self.flush()
        if self._stream is not None and self.part is not None and self.path is not None:
            self._stream.close()
            if self.part != self.path:
                self.part.replace(self.path)

    def discard(self) -> None:
        """Leave nothing behind of a file that would have been complete only later."""
        if self.part is not None and self._stream is not None:
            self._stream.close()
            if self.part != self.path:
                self.part.unlink(missing_ok=True)
