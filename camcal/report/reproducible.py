"""`--reproducible`: removal of everything that differs between runs with the same input and options."""

from __future__ import annotations

from typing import Any

#: keys of times; they stay, as null, so that a report has the same keys
TIMES = ("seconds", "date")


def without_times(value: Any, known: tuple[str, ...] = TIMES) -> Any:
    """The document with null instead of times; `options` are the user's and are kept."""
    if isinstance(value, dict):
        return {
            name: None if name in known else part if name == "options" else without_times(part, known)
            for name, part in value.items()
        }
    if isinstance(value, list):
        return [without_times(part, known) for part in value]
    return value
