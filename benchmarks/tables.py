"""Tables of the benchmarks, and the pages that hold them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any


def markdown(header: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A table in Markdown."""
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    return "\n".join(lines + ["| " + " | ".join(str(c) for c in row) + " |" for row in rows])


def update(page: Path, name: str, text: str) -> None:
    """Put a table between `<!-- name -->` and `<!-- /name -->` of a page."""
    old = page.read_text(encoding="utf-8")
    head, begin, rest = old.partition(f"<!-- {name} -->")
    _, end, tail = rest.partition(f"<!-- /{name} -->")
    if not begin or not end:
        raise SystemExit(f"{page} has no place for the table '{name}'")
    page.write_text(f"{head}{begin}\n{text}\n{end}{tail}", encoding="utf-8")


def show(page: Path | None, name: str, text: str) -> None:
    """Print a table, and put it into a page where one is given."""
    print(text)
    if page is not None:
        update(page, name, text)


def keep(path: Path, row: Any) -> None:
    """Append a row of a study to a file, so that the study can be run in pieces."""
    with path.open("a") as file:
        file.write(json.dumps(row) + "\n")


def kept(path: Path | None) -> list[Any]:
    """The rows of a study so far; none where there is no file yet."""
    return [json.loads(line) for line in path.read_text().splitlines()] if path and path.exists() else []
