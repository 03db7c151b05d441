"""Atomic writing of files, which never overwrites another file unless asked to.

What is written goes to a file beside the target with an unpredictable name, which then takes the target's name.
Such a file is locked for as long as it is written. One that is not locked was left by a process that was
killed, and the next run that writes into the folder removes it.
"""

from __future__ import annotations

import contextlib
import os
import re
import stat
from collections.abc import Iterator
from pathlib import Path

from camcal.errors import DataError, UsageError
from camcal.system.text import readable

try:
    import fcntl
except ImportError:  # not a POSIX system: a file that is open cannot be removed there
    fcntl = None  # type: ignore[assignment]

_PART = re.compile(r"\..*\.[0-9a-f]{16}\.camcal\.part")
_CHUNK = 1 << 20  #: bytes that are written at a time
#: never somebody else's file or link; O_BINARY exists on Windows, O_NOFOLLOW and O_CLOEXEC do not
_NEW = os.O_WRONLY | os.O_CREAT | os.O_EXCL
_NEW |= getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)
#: folders that this process has swept
_swept: set[str] = set()


def check_writable(path: str | os.PathLike, force: bool = False) -> None:
    """Raise now what `atomic_write` would raise later, so that a long job does not fail at its end.

    Raises
    ------
    UsageError
        If the file exists and `force` is false, where it is a folder or `-`, or where its folder is missing
        or read-only.
    """
    target = Path(path)
    if os.fspath(path) == "-":
        raise UsageError(
            "'-' is not a file name.", "Without -o, results go to stdout, with --format as YAML or JSON."
        )
    if target.is_dir():
        raise UsageError(f"cannot write '{target}': it is a folder.", "Give the name of a file.")
    folder = target.parent
    if not folder.is_dir():
        found = "is a file" if folder.exists() else "does not exist"
        raise UsageError(
            f"cannot write '{target}': the folder '{folder}' {found}.", "Create the folder first."
        )
    if is_special(target):
        if not os.access(target, os.W_OK):
            raise UsageError(f"cannot write '{target}': permission denied.", "Choose another file.")
        return
    if not os.access(folder, os.W_OK | os.X_OK):
        raise UsageError(f"cannot write '{target}': the folder '{folder}' is read-only.", "Choose another.")
    if target.exists() and not force:
        raise UsageError(f"'{target}' exists already.", "Choose another name, or overwrite it with --force.")
    if target.exists() and not os.access(target, os.W_OK):
        raise UsageError(f"cannot write '{target}': the file is read-only.", "Choose another name.")


def is_special(path: Path) -> bool:
    """Return whether a path is a device, a pipe or a socket, which is written to and never replaced."""
    return path.exists() and not path.is_file() and not path.is_dir()


def atomic_write(path: str | os.PathLike, content: str | bytes, force: bool = False) -> None:
    """Write a file atomically.

    A process that reads meanwhile sees the old file or the new one. Text is written as UTF-8 with the line ends
    it has. A device or a pipe (`/dev/stdout`) is written to directly. A symbolic link stays; its target is
    replaced.

    Raises
    ------
    UsageError
        As `check_writable`; also where another program has made the file meanwhile.
    DataError
        If the system refuses to write (a full disk).
    """
    check_writable(path, force)
    data = readable(content).encode("utf-8") if isinstance(content, str) else content
    target = Path(path)
    with refusals(target):
        if is_special(target):
            with target.open("wb", buffering=0) as stream:
                write_all(stream.fileno(), data)
            return
        part = PartFile(target)
        try:
            part.write(data)
            part.commit(force)
        except BaseException:  # also on ^C and SIGTERM: the half-written file must go
            part.discard()
            raise


@contextlib.contextmanager
def refusals(target: str | os.PathLike) -> Iterator[None]:
    """Convert an error of the system into one that says that `target` could not be written."""
    try:
        yield
    except BrokenPipeError:  # the reader of a pipe went away: exit code 141
        raise
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        raise DataError(f"cannot write '{target}': {why}.", "Choose another place.") from error


def write_all(handle: int, data: bytes) -> None:
    """Write bytes to a descriptor; the system may take fewer at a time."""
    left = memoryview(data)
    while len(left):
        left = left[os.write(handle, left[:_CHUNK]) :]


class PartFile:
    """A file being written, which is renamed to its target when it is complete.

    Parameters
    ----------
    target : path
        A symbolic link is followed: what it leads to is replaced.
    """

    def __init__(self, target: str | os.PathLike):
        self.target = Path(os.path.realpath(target))
        sweep(self.target.parent)
        while True:
            name = f".{self.target.name[:40]}.{os.urandom(8).hex()}.camcal.part"
            self.path = self.target.with_name(name)
            # the system takes the umask off 0o666, as for any new file
            self._handle = os.open(self.path, _NEW, 0o666)
            if fcntl is None or (_lock(self._handle) and os.fstat(self._handle).st_nlink):
                return
            os.close(self._handle)  # swept by another run before it was locked

    def write(self, data: bytes) -> None:
        """Append data."""
        write_all(self._handle, data)

    def commit(self, force: bool) -> None:
        """Rename the file to its target.

        Raises
        ------
        UsageError
            If a file of that name exists and `force` is false.
        """
        os.fsync(self._handle)
        if fcntl is None:
            self._close()
        if force and self.target.exists():
            self.path.chmod(self.target.stat().st_mode & 0o777)
        if force:
            os.replace(self.path, self.target)  # noqa: PTH105 - the calls of a write are counted by tests
        else:
            self._take_free_name()
        self._close()

    def _take_free_name(self) -> None:
        try:
            os.link(self.path, self.target)
        except FileExistsError:
            said = f"'{self.target}' exists already."
            raise UsageError(
                said, "Another program created it in the meantime; overwrite it with --force."
            ) from None
        except OSError:  # a file system without hard links
            if self.target.exists():
                raise UsageError(
                    f"'{self.target}' exists already.", "Another program created it in the meantime."
                ) from None
            os.replace(self.path, self.target)  # noqa: PTH105
        else:
            os.unlink(self.path)  # noqa: PTH108

    def discard(self) -> None:
        """Remove the file unless it was renamed."""
        self._close()
        with contextlib.suppress(OSError):
            os.unlink(self.path)  # noqa: PTH108

    def _close(self) -> None:
        if self._handle >= 0:
            handle, self._handle = self._handle, -1
            os.close(handle)


def _lock(handle: int) -> bool:
    """Lock an open file for this process; False if another process has locked it. The lock ends with the process."""
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks
        return True
    return True


def lock_or_refuse(handle: int, path: str | os.PathLike) -> None:
    """Lock a file that grows; UsageError if another run is writing to it."""
    if fcntl is not None and not _lock(handle):
        raise UsageError(f"'{path}' is being written by another run.", "Choose another --output.")


def sweep(folder: Path) -> None:
    """Remove files that killed runs of this user left in a folder, once per process; locked ones are kept."""
    if str(folder) in _swept or fcntl is None:
        return
    _swept.add(str(folder))
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if _PART.fullmatch(entry.name):
                with contextlib.suppress(OSError):
                    _remove_stale(entry.path)


def _remove_stale(path: str) -> None:
    """Remove a part file of this user that no process has locked; links are not followed."""
    handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        status = os.fstat(handle)
        if not stat.S_ISREG(status.st_mode) or status.st_uid != os.geteuid():
            return
        fcntl.flock(
            handle, fcntl.LOCK_EX | fcntl.LOCK_NB
        )  # OSError: it is being written, or locks are unknown
        os.unlink(path)  # noqa: PTH108
    finally:
        os.close(handle)
