"""The common head of camcal's documents."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

import numpy as np

from camcal.schema import SCHEMA
from camcal.version import __version__


def head(command: Sequence[str]) -> dict[str, Any]:
    """The entries `schema`, `tool`, `command` and `date`; `command` are the words after `camcal`, as typed."""
    now = datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")
    return {"schema": SCHEMA, "tool": tool(), "command": list(command), "date": now}


def tool() -> dict[str, str]:
    """Versions of the software that makes the document."""
    import cv2

    return {
        "camcal": __version__,
        "opencv": cv2.__version__,
        "numpy": np.__version__,
        "python": platform.python_version(),
    }
