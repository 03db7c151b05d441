"""Functions shared by the JSON formats."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any


def dump(content: Any) -> str:
    """JSON text, indented, every float with all its digits."""
    return json.dumps(content, indent=2, allow_nan=False) + "\n"


def has(found: Any, *names: str) -> bool:
    """Return whether a value is a mapping with all of these keys."""
    return isinstance(found, Mapping) and all(n in found for n in names)
