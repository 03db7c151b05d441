"""The destination of the rows: a file that appears when it is complete, one that grows, or stdout."""

from __future__ import annotations

import contextlib
import os
import sys
from pathlib import Path
from typing import Any

from camcal.errors import UsageError
from camcal.system.writing import PartFile, is_special, lock_or_refuse, refusals, write_all
from camcal.track.estimator import TrackState
from camcal.track.table import Table


class Output:
    """Collects states and writes their rows in blocks.

    Parameters
    ----------
    table : Table
    format : {"csv", "jsonl"}
    path : Path or None
        None: stdout.
    growing : bool
        Whether the file is written in place as rows come: for pipes and for runs that may be taken up again.
        Otherwise it is written to a temporary file beside it, which takes its name when it is complete.
    force : bool
        Whether a file of this name that another program has made meanwhile may be replaced.
    block : int
        Rows that are turned into text at once.
    """

    def __init__(
        self,
        table: Table,
        format: str = "csv",
        path: Path | None = None,
        growing: bool = False,
        force: bool = True,
        block: int = 256,
    ):
        self.table, self.format, self.force, self.block = table, format, force, block
        self.special = path is None or is_special(path)  # a device or a pipe is never replaced
        self.growing = growing or self.special
        # a symbolic link stays; its target is replaced
        self.path = path if path is None or self.special else Path(os.path.realpath(path))
        self._part: PartFile | None = None
        self._handle = -1
        self._states: list[TrackState] = []
        self._begun = False

    def add(self, state: TrackState) -> None:
        """Take a state; its row is written with the block it belongs to."""
        self._states.append(state)
        if len(self._states) >= self.block:
            self.flush()

    def flush(self) -> int:
        """Write the collected rows; return the number of bytes in the file, 0 for stdout, devices and pipes."""
        text = ""
        if not self._begun:
            self._begun = True
            text = self.table.header if self.format == "csv" else ""
        if self._states:
            text += self.table.csv(self._states) if self.format == "csv" else self.table.jsonl(self._states)
            self._states = []
        if self.path is None:
            sys.stdout.write(text)
            sys.stdout.flush()
            return 0
        with self._refusals():
            self._open()
            self._write(text.encode("utf-8"))
            return 0 if self.special or self._part else os.lseek(self._handle, 0, os.SEEK_CUR)

    def _write(self, data: bytes) -> None:
        if self._part is not None:
            self._part.write(data)
        else:
            write_all(self._handle, data)

    def _refusals(self) -> Any:
        return contextlib.nullcontext() if self.path is None else refusals(self.path)

    def _open(self, size: int = 0) -> None:
        """Open the file, once; for a growing one, keep the first `size` bytes."""
        if self.path is None or self._handle >= 0 or self._part is not None:
            return
        if self.special:
            self._handle = os.open(self.path, os.O_WRONLY | os.O_CLOEXEC)
        elif self.growing:
            self._handle = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
            lock_or_refuse(self._handle, self.path)
            os.truncate(self._handle, size)
            os.lseek(self._handle, 0, os.SEEK_END)
        else:
            self._part = PartFile(self.path)

    def resume(self, size: int) -> None:
        """Continue a file whose first `size` bytes are valid; on stdout, a device or a pipe, continue without a
        header.

        Raises
        ------
        UsageError
            If the file is missing or shorter, or another run writes to it.
        """
        if self.special or not size:
            self._begun = self.special
            return
        assert self.path is not None
        found = self.path.stat().st_size if self.path.is_file() else 0
        if found < size:
            raise UsageError(
                f"{self.path}: {found} bytes found; the state belongs to a table of at least {size}.",
                "Give the table that the state was made with, or start again with another --state.",
            )
        self._begun = True
        with self._refusals():
            self._open(size)

    def finish(self) -> None:
        """Close the file and rename it to its final name.

        Raises
        ------
        UsageError
            If another program has made a file of that name meanwhile.
        DataError
            If the system refuses to write.
        """
        self.flush()
        with self._refusals():
            if self._part is not None:
                self._part.commit(self.force)
            elif self._handle >= 0 and not self.special:
                os.fsync(self._handle)
        self._close()

    def discard(self) -> None:
        """Remove the temporary file of a table that will not be completed."""
        if self._part is not None:
            self._part.discard()
        self._close()

    def _close(self) -> None:
        if self._handle >= 0:
            handle, self._handle = self._handle, -1
            os.close(handle)
