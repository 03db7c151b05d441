"""A cache of detections and second passes, keyed by the hash of the picture and all that the result depends on.

An entry is an npz file with plain arrays and a text; one that cannot be read is ignored and rewritten.
"""

from __future__ import annotations

import functools
import hashlib
import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import platformdirs

from camcal.data import npz
from camcal.errors import CamcalError
from camcal.system.reading import read_file
from camcal.system.writing import atomic_write

LARGEST = 64 << 20  #: bytes of an entry: a board of 1000 x 1000 points, four arrays of two numbers each
#: rooms of the package whose code decides what is found in a picture
ROOMS = ("detect", "geometry", "least_squares", "model")


def default_folder() -> Path | None:
    """The platform's cache folder: `$XDG_CACHE_HOME/camcal` or `~/.cache/camcal` on Linux; None without a home."""
    try:
        return platformdirs.user_cache_path("camcal", appauthor=False) / "detections"
    except RuntimeError:  # the system does not know the user
        return None


def use(folder: Path | None) -> None:
    """State where the results of this search, and of the second pass over its pictures, are kept; None for nowhere."""
    _used[:] = [folder]


def in_use() -> Path | None:
    """The folder of the last search."""
    return _used[0]


_used: list[Path | None] = [None]


@functools.cache
def code() -> str:
    """A hash of the sources on which a detection depends, so that entries become invalid when the code changes."""
    package = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for room in ROOMS:
        for path in sorted((package / room).rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def entry(folder: Path, picture_sha256: str, detector: str) -> Path:
    """The file of a picture under one set of options; `detector` names the options and the code."""
    options = hashlib.sha256(detector.encode()).hexdigest()[:16]
    return folder / picture_sha256[:2] / f"{picture_sha256[2:]}-{options}.npz"


def load(path: Path) -> tuple[dict[str, np.ndarray], dict[str, Any]] | None:
    """The arrays and values of an entry; None if it is missing or damaged."""
    try:
        stream = io.BytesIO(read_file(path, LARGEST))
        arrays = npz.arrays(stream, npz.names(stream), LARGEST)
        values = json.loads(str(arrays.pop("values")[()]))
    except (CamcalError, RecursionError, *npz.BROKEN):
        return None
    return (arrays, values) if isinstance(values, dict) else None


def store(path: Path, arrays: Mapping[str, np.ndarray], values: Mapping[str, Any]) -> str | None:
    """Write an entry atomically; return the reason if that fails."""
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
