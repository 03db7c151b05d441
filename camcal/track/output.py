"""Where the rows go: a file that appears when it is complete, one that grows, or stdout."""

from __future__ import annotations

import os
import secrets
import sys
from pathlib import Path
from typing import IO

from camcal.data.writing import is_special
from camcal.errors import UsageError
from camcal.track.estimator import TrackState
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
        self.path = path if path is None or self.special else path.resolve()
        self._part: Path | None = None
        self._stream: IO[str] | None = None
        self._states: list[TrackState] = []
        self._begun = False

    def add(self, state: TrackState) -> None:
        """Take a state; its row is written with the block it belongs to."""
        self._states.append(state)
        if len(self._states) >= self.block:
            self.flush()

    def flush(self) -> int:
        """Write what there is; the number of bytes in the file so far, 0 for stdout, devices and pipes."""
        stream = self._stream = self._stream or self._open("w")
        if not self._begun:
            self._begun = True
            if self.format == "csv":
                stream.write(self.table.header)
        if self._states:
            stream.write(
                self.table.csv(self._states) if self.format == "csv" else self.table.jsonl(self._states)
            )
            self._states = []
        stream.flush()
        return 0 if self.special else stream.tell()

    def _open(self, mode: str) -> IO[str]:
        if self.path is None:
            return sys.stdout
        if self.growing:
            stream = self.path.open(mode if self.special else "a+", encoding="utf-8", newline="")
            if not self.special:
                _lock(stream, self.path)
                if mode == "w":
                    stream.truncate(0)
            return stream
        self._part = self.path.with_name(f".{self.path.name[:40]}.{secrets.token_hex(8)}.part")
        # O_EXCL: never a file, or a link, that somebody else has put there
        handle = os.open(self._part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)
        return os.fdopen(handle, "w", encoding="utf-8", newline="")

    def resume(self, size: int) -> None:
        """Go on with a file of which the first `size` bytes count; with stdout, a device or a pipe, go on
        without a header.

        Raises
        ------
        UsageError
            Where the file is missing or shorter, or another run writes to it.
        """
        if self.special or not size:
            self._begun = self.special
            return
        assert self.path is not None
        found = self.path.stat().st_size if self.path.is_file() else 0
        if found < size:
            raise UsageError(
                f"{self.path}: {found} bytes found; the state belongs to a table of at least {size}.",
                "Give the table that the state was made with, or begin anew with another --state.",
            )
        self._begun = True
        self._stream = self._open("a+")
        self._stream.truncate(size)

    def finish(self) -> None:
        """Close the file; it takes its name.

        Raises
        ------
        UsageError
            Where another program has made a file of that name meanwhile.
        """
        self.flush()
        if self._stream is None or self.path is None:
            return
        self._stream.close()
        if self._part is not None:
            if self.force or not self.path.exists():
                self._part.replace(self.path)
            else:
                raise UsageError(f"'{self.path}' exists already.", "Another program made it meanwhile.")

    def discard(self) -> None:
        """Remove the temporary file of a table that will not be completed."""
        if self._stream is not None and self.path is not None:
            self._stream.close()
        if self._part is not None:
            self._part.unlink(missing_ok=True)


def _lock(stream: IO[str], path: Path) -> None:
    """Refuse a growing table that another run is writing to; the system drops the lock with the process."""
    try:
        import fcntl
    except ImportError:  # not a POSIX system: no such lock
        return
    try:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        stream.close()
        raise UsageError(f"'{path}' is being written by another run.", "Choose another --output.") from None
    except OSError:  # a file system without locks
        return
