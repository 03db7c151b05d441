"""Output for the user: results on stdout, everything else on stderr.

`rich` is imported inside the functions, so that `--help` does not pay for it.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import click

from camcal.cli.verbosity import verbosity
from camcal.system.streams import Outlet
from camcal.system.text import printable

WIDTH_OFF_A_TERMINAL = 80
REDRAWN = 0.1  #: s; between two pictures of a progress bar, each of which takes about a millisecond


def emit(document: Any, format: str, as_table: Callable[[], Any]) -> None:
    """Write a result to stdout: exactly one JSON or YAML document, or the table that `as_table` makes.

    Parameters
    ----------
    document : dict or list
        What `camcal.report.plain` takes: arrays and numpy scalars too.
    format : str
        "table", "json" or "yaml".
    as_table : callable
        Returns what rich can print: a string, a table, a group of them.
    """
    if format == "table":
        console().print(as_table())
        return
    from camcal.report.plain import plain
    from camcal.report.yaml import dump_json, dump_yaml

    click.echo((dump_json if format == "json" else dump_yaml)(plain(document)), nl=False)


def console(stderr: bool = False) -> Any:
    """Return a rich console: the terminal's width, or 80 columns if the stream is not a terminal."""
    from rich.console import Console
    from rich.segment import Segment

    class SafeConsole(Console):
        """A console that leaves broken pipes to camcal's boundary; rich would exit by itself.

        What a terminal would obey is taken from all text before rich adds its own styles.
        """

        def on_broken_pipe(self) -> None:
            raise BrokenPipeError

        def render(self, renderable: Any, options: Any = None) -> Iterator[Segment]:
            for part in super().render(renderable, options):
                yield part if part.control else Segment(printable(part.text), part.style)

    stream: Any = sys.stderr if stderr else sys.stdout
    stream = stream.styled() if isinstance(stream, Outlet) else stream
    width = None if stream.isatty() else WIDTH_OFF_A_TERMINAL
    return SafeConsole(file=stream, width=width, highlight=False, emoji=False, soft_wrap=False)


@contextmanager
def progress(label: str) -> Iterator[Callable[[int, int], None]]:
    """Show progress on stderr; the body calls the yielded function with (done, total).

    Off a terminal and with -q nothing is shown.
    """
    if not sys.stderr.isatty() or verbosity() < 0:
        yield lambda done, total: None
        return
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    # drawn by this thread: with one of its own, the process could not be copied
    with Progress(*columns, console=console(stderr=True), transient=True, auto_refresh=False) as bar:
        task, drawn = bar.add_task(label, total=None), -math.inf

        def show(done: int, total: int) -> None:
            nonlocal drawn
            due = time.monotonic() >= drawn + REDRAWN
            bar.update(task, completed=done, total=total, refresh=due)
            drawn = time.monotonic() if due else drawn

        yield show


def table(header: Sequence[str], rows: Sequence[Sequence[Any]], title: str | None = None) -> Any:
    """Return a rich table; columns of numbers are right-aligned."""
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
    """Format a number: `digits` significant digits, integers unchanged, a dash for None."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "-"
    return f"{value:.{digits}g}" if isinstance(value, float) else str(value)


def write_for_ci(command: str, suite: str, checks: Sequence[Any], options: Mapping[str, Any]) -> None:
    """Write the files for --junit and --annotations."""
    if options["junit"] is not None:
        from camcal.data.writing import atomic_write
        from camcal.report.ci import junit

        atomic_write(options["junit"], junit(command, suite, checks), options["force"])
    if options["annotations"]:
        from camcal.report.ci import ANNOTATIONS

        click.echo(ANNOTATIONS[options["annotations"]](command, checks), err=True, nl=False)
