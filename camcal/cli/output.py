"""What the user sees: results on stdout, everything else on stderr.

`rich` is imported inside the functions, so that `--help` does not pay for it.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click

from camcal.errors import UsageError

WIDTH_OFF_A_TERMINAL = 80


def emit(document: Any, format: str, as_table: Callable[[], Any]) -> None:
    """Write a result to stdout: exactly one JSON or YAML document, or the table that `as_table` makes."""
    if format == "json":
        import json

        click.echo(json.dumps(plain(document), indent=2, ensure_ascii=False, allow_nan=False))
    elif format == "yaml":
        import yaml

        text = yaml.safe_dump(plain(document), sort_keys=False, allow_unicode=True, default_flow_style=None)
        click.echo(text, nl=False)
    else:
        console().print(as_table())


def plain(value: Any) -> Any:
    """Turn arrays, numpy scalars, tuples and paths into what JSON and YAML hold; NaN and inf become null."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):  # numpy's arrays and scalars, without importing numpy
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value


def console(stderr: bool = False) -> Any:
    """Return a rich console: the terminal's width, or 80 columns where the stream is no terminal."""
    from rich.console import Console

    stream = sys.stderr if stderr else sys.stdout
    width = None if stream.isatty() else WIDTH_OFF_A_TERMINAL
    return Console(file=stream, width=width, highlight=False, soft_wrap=False)


def table(header: Sequence[str], rows: Sequence[Sequence[Any]], title: str | None = None) -> Any:
    """Return a rich table; columns whose cells are numbers stand on the right."""
    from rich.markup import escape
    from rich.table import Table

    made = Table(title=title, box=None, pad_edge=False, title_justify="left", header_style="bold")
    for index, name in enumerate(header):
        cells = [row[index] for row in rows if row[index] is not None]
        numeric = bool(cells) and all(isinstance(cell, (int, float)) for cell in cells)
        made.add_column(name, justify="right" if numeric else "left", overflow="fold")
    for row in rows:
        made.add_row(*(escape(number(cell)) if not isinstance(cell, str) else escape(cell) for cell in row))
    return made


def number(value: Any, digits: int = 6) -> str:
    """Write a number for people: `digits` significant digits, integers as they are, a dash for nothing."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "-"
    return f"{value:.{digits}g}" if isinstance(value, float) else str(value)


def check_output(path: Path | None, force: bool) -> None:
    """Refuse an output that exists or cannot be written, before any work is done.

    Raises
    ------
    UsageError
        Where the file exists and `force` is not set, or its folder does not exist.
    """
    if path is None:
        return
    if path.is_dir():
        raise UsageError(
            f"--output: {path} is a folder; a file is needed.", f"Try: -o {path / 'report.yaml'}"
        )
    if path.exists() and not force:
        raise UsageError(f"{path} exists.", "--force overwrites it; -o names another file.")
    if not path.parent.is_dir():
        raise UsageError(f"the folder {path.parent} does not exist.", f"Try: mkdir -p {path.parent}")
