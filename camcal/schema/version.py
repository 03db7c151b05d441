"""The name of the report's schema, and the versions that a reader accepts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from camcal.errors import DataError

NAME = "camcal-report"
VERSION = 1
SCHEMA = f"{NAME}/{VERSION}"


def check(document: Mapping[str, Any], source: str) -> None:
    """Raise an error unless a document is a camcal report of a version that this camcal reads.

    Raises
    ------
    DataError
    """
    found = document.get("schema")
    name, _, version = str(found).partition("/")
    if found is None or name != NAME:
        raise DataError(
            f"'{source}' is not a camcal report: it has no 'schema: {SCHEMA}'.",
            "A report is what `camcal estimate -o report.yaml` writes.",
        )
    if not version.isdigit() or int(version) > VERSION:
        raise DataError(
            f"'{source}' has schema {found}; this camcal reads {SCHEMA}.",
            "It was written by a newer camcal: upgrade.",
        )
