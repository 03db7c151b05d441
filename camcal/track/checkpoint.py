"""Checkpoint files: a run continues after it was killed, with bit-identical results.

The first line names the schema and the SHA-256 of the second, which is one JSON document (camcal.track.keep).
"""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from camcal.errors import CamcalError, DataError, UsageError
from camcal.system.reading import read_text
from camcal.system.writing import atomic_write, sweep
from camcal.track.keep import pack, unpack

SCHEMA = "camcal-track-state/2"
_HINT = "Choose another --state."
#: bytes; a state of some hundred parameters with its window of frames is below 10 MB
LARGEST = 256 << 20


def save(path: Path, content: Mapping[str, Any]) -> None:
    """Write a checkpoint atomically: a reader sees either the old one or the new one."""
    body = json.dumps(pack(content))
    head = json.dumps({"schema": SCHEMA, "sha256": _digest(body)})
    atomic_write(path, f"{head}\n{body}\n", force=True)


def load(path: Path) -> dict[str, Any]:
    """Read a checkpoint, and remove temporary files that a killed run left behind.

    Raises
    ------
    DataError
        If the file is no checkpoint of this version, or is damaged.
    """
    sweep(path.resolve().parent)
    head, _, body = read_text(path, LARGEST, "a state of `camcal track`", _HINT).partition("\n")
    try:
        found = json.loads(head)
    except (ValueError, RecursionError):
        raise DataError(f"{path}: not a state of `camcal track`.", _HINT) from None
    if not isinstance(found, dict) or found.get("schema") != SCHEMA:
        raise DataError(f"{path}: not a state of `camcal track`; the schema {SCHEMA} is needed.", _HINT)
    body = body.removesuffix("\n")
    if found.get("sha256") != _digest(body):
        raise DataError(f"{path}: the state is damaged: its checksum does not match.", _HINT)
    with damage(path):
        return json.loads(body, object_hook=unpack)


@contextlib.contextmanager
def damage(path: Path) -> Iterator[None]:
    """Report any error in the contents of a state as damage: its checksum proves only that it is complete."""
    try:
        yield
    except CamcalError:
        raise
    except (ArithmeticError, AttributeError, LookupError, MemoryError, RecursionError) as error:
        raise _damaged(path, error) from error
    except (TypeError, ValueError, np.linalg.LinAlgError) as error:
        raise _damaged(path, error) from error


def _damaged(path: Path, error: Exception) -> DataError:
    said = str(error).partition("\n")[0][:200] or type(error).__name__
    what = f"{said} is missing" if isinstance(error, KeyError) else said
    return DataError(f"{path}: the state is damaged: {what}.", _HINT)


def require_same(path: Path, saved: Mapping[str, Any], now: Mapping[str, Any]) -> None:
    """Reject options that differ from those of the checkpoint."""
    saved, now = (json.loads(json.dumps(pack(options))) for options in (saved, now))
    for name, value in now.items():
        if saved.get(name) != value:
            raise UsageError(
                f"{path}: the state was made with {name} = {saved.get(name)!r}, not {value!r}.",
                "Use the same options, or start again with another --state.",
            )


def _digest(body: str) -> str:
    return hashlib.sha256(body.encode()).hexdigest()
