"""The log of an internal error: traceback, command, versions."""

from __future__ import annotations

import contextlib
import os
import platform
import shlex
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator, Sequence
from importlib import metadata
from pathlib import Path

import platformdirs

from camcal.version import __version__

PACKAGES = ("numpy", "scipy", "opencv-contrib-python-headless", "click", "PyYAML", "rich")


def write_log(error: Exception, args: Sequence[str]) -> Path | None:
    """Write the details of an internal error; return the path, or None if no folder is writable."""
    text = "\n".join(
        [
            f"camcal {__version__} · {time.strftime('%Y-%m-%dT%H:%M:%S%z')}",
            f"command: camcal {shlex.join(args)}",
            f"python {sys.version.split()[0]} on {platform.platform()}",
            *(f"{name} {_version(name)}" for name in PACKAGES),
            "",
            "".join(traceback.format_exception(error)),
        ]
    )
    name = f"bug-{time.strftime('%Y%m%d-%H%M%S')}-{os.getpid()}.log"
    for folder in _folders():
        try:
            folder.mkdir(parents=True, exist_ok=True)
            path = folder / name
            path.write_text(text, encoding="utf-8", errors="backslashreplace")
        except OSError:
            continue  # the next folder is tried; the caller says so where none is left
        return path
    return None


def _folders() -> Iterator[Path]:
    """Folders for a log, best first: the platform's state folder, the temporary folder."""
    with contextlib.suppress(RuntimeError):  # the system does not know the user
        yield platformdirs.user_state_path("camcal", appauthor=False)
    with contextlib.suppress(OSError):
        yield Path(tempfile.gettempdir())


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"
