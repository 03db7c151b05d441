"""Reading whole files: with a size limit, and only regular files."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from camcal.errors import DataError

#: a pipe without a writer is not waited for (O_NONBLOCK); Windows has neither flag
_FLAGS = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)


def read_file(
    path: str | os.PathLike, most: int, what: str = "a file", hint: str = "Check the path."
) -> bytes:
    """The bytes of a regular file.

    Parameters
    ----------
    path : path
    most : int
        Bytes; a larger file is refused before it is read.
    what : str
        What is needed, for messages: "a camcal report".
    hint : str

    Raises
    ------
    DataError
        If it is missing, a folder, a device or a pipe, too large, or cannot be read.
    """
    try:
        with os.fdopen(os.open(path, _FLAGS), "rb") as stream:
            status = os.fstat(stream.fileno())
            if not stat.S_ISREG(status.st_mode):
                found = "a folder" if stat.S_ISDIR(status.st_mode) else "not a regular file"
                raise DataError(f"'{path}' is {found}; {what} is needed.", _other(status.st_mode))
            data = b"" if status.st_size > most else stream.read(most + 1)
    except FileNotFoundError:
        raise DataError(f"there is no file '{path}'.", hint) from None
    except IsADirectoryError:  # of Windows and of some file systems
        raise DataError(f"'{path}' is a folder; {what} is needed.", "Name the file in it.") from None
    except MemoryError:
        raise DataError(f"there is not enough memory to read '{path}'.", "Is it the right file?") from None
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
        reason = getattr(error, "strerror", None) or str(error)
        raise DataError(f"cannot read '{path}': {reason.lower()}.", hint) from None
    if status.st_size > most or len(data) > most:
        raise DataError(f"'{path}' has more than {_size(most)}; {what} is smaller.", "Is it the right file?")
    return data


def read_text(
    path: str | os.PathLike, most: int, what: str = "a text file", hint: str = "Check the path."
) -> str:
    """The text of a regular file in UTF-8, without a byte order mark; DataError as `read_file`."""
    data = read_file(path, most, what, hint)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise DataError(f"cannot read '{path}': it is not text; {what} is needed.", hint) from None


def _size(most: int) -> str:
    return f"{most >> 20} MB" if most >= 1 << 20 else f"{most} bytes"


def _other(mode: int) -> str:
    return "Name the file in it." if stat.S_ISDIR(mode) else "Copy it to a file first."


def is_file(path: str | os.PathLike) -> bool:
    """Return whether the path is a regular file; False for a loop of links and for names that the system rejects."""
    try:
        return Path(path).is_file()
    except (OSError, ValueError):
        return False
