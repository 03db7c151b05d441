"""A cache of detections and second passes, keyed by a hash of the picture and of everything the result depends on.

An entry is an npz file with plain arrays and a text; an unreadable one is ignored and rewritten. Once a day the least
recently used entries are removed until the rest take at most `LIMIT`.
"""

from __future__ import annotations

import functools
import hashlib
import io
import json
import os
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import platformdirs

from camcal.data import npz
from camcal.errors import CamcalError
from camcal.system.reading import read_file
from camcal.system.writing import atomic_write

LARGEST = 64 << 20  #: bytes of the largest entry: 1000 x 1000 points, four arrays of two numbers each
#: bytes of all entries: a picture of a board takes about 10 kB for each search and each second pass, so that all
#: entries of 10,000 pictures fit
LIMIT = 512 << 20
KEPT = 0.9  #: share of the limit that remains in use after pruning, so that there is space for new entries
PRUNED = "pruned"  #: file whose modification time is that of the last pruning
INTERVAL = 86400.0  #: s between two prunings: one takes some 10 ms for every 1,000 entries
#: rooms of the package whose code decides what is found in a picture
ROOMS = ("detect", "geometry", "least_squares", "model")


def default_folder() -> Path | None:
    """The platform's cache folder: `$XDG_CACHE_HOME/camcal` or `~/.cache/camcal` on Linux; None without a home."""
    try:
        return platformdirs.user_cache_path("camcal", appauthor=False) / "detections"
    except RuntimeError:  # the system does not know the user
        return None


def use(folder: Path | None) -> None:
    """Set the folder in which this search and the second pass over its pictures keep their results; None for none."""
    _used[:] = [folder]
    if folder is not None:
        _prune_daily(folder)


def in_use() -> Path | None:
    """The folder set by the last search."""
    return _used[0]


_used: list[Path | None] = [None]


def _prune_daily(folder: Path) -> None:
    mark = folder / PRUNED
    with suppress(OSError):
        if not folder.is_dir() or (mark.exists() and abs(time.time() - mark.stat().st_mtime) < INTERVAL):
            return
        mark.touch()
        prune(folder)


def prune(folder: Path, limit: int = LIMIT) -> int:
    """Remove the least recently used entries if all together take more than `limit` bytes.

    Returns
    -------
    int
        How many were removed; the others take at most `KEPT` of the limit.
    """
    entries = []
    for path in folder.glob("??/*.npz"):
        with suppress(OSError):  # another process removed it
            said = path.stat()
            entries.append((said.st_mtime, said.st_size, path))
    total, removed = sum(size for _, size, _ in entries), 0
    if total <= limit:
        return 0
    for _, size, path in sorted(entries):
        if total <= KEPT * limit:
            break
        with suppress(OSError):
            path.unlink()
            total, removed = total - size, removed + 1
    return removed


@functools.cache
def code() -> str:
    """A hash of the source files that a detection depends on, so that a change of the code invalidates the entries."""
    package = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for room in ROOMS:
        for path in sorted((package / room).rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def entry(folder: Path, picture_sha256: str, detector: str) -> Path:
    """The file of the entry of a picture with one set of options; `detector` names the options and the code."""
    options = hashlib.sha256(detector.encode()).hexdigest()[:16]
    return folder / picture_sha256[:2] / f"{picture_sha256[2:]}-{options}.npz"


def load(path: Path) -> tuple[dict[str, np.ndarray], dict[str, Any]] | None:
    """The arrays and values of an entry; None if it is missing or damaged."""
    try:
        stream = io.BytesIO(read_file(path, LARGEST))
        arrays = npz.arrays(stream, npz.names(stream), LARGEST)
        values = json.loads(str(arrays.pop("values")[()]))
        with suppress(OSError):
            os.utime(path)  # used now; see `prune`
    except (CamcalError, RecursionError, *npz.BROKEN):
        return None
    return (arrays, values) if isinstance(values, dict) else None


def store(path: Path, arrays: Mapping[str, np.ndarray], values: Mapping[str, Any]) -> str | None:
    """Write an entry atomically; return the reason on failure."""
    stream = io.BytesIO()
    np.savez(stream, allow_pickle=False, values=np.array(json.dumps(values)), **arrays)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        atomic_write(path, stream.getvalue(), force=True)
    except OSError as error:
        return error.strerror or str(error)
    except CamcalError as error:
        return error.message
    return None
