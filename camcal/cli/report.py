"""`camcal report`: a report as a page for people, and its charts as files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from camcal.cli.options import options
from camcal.cli.verbosity import note, verbosity_options

FILE = click.Path(path_type=Path)


@click.command("report")
@click.argument("report", type=FILE, metavar="REPORT")
@options("report")
@verbosity_options
def command(report: Path, output: Path | None, plots: Path | None, **options: Any) -> None:
    """Show a report as one self-contained HTML page.

    The page needs no network and no other file: verdict, parameters, residuals, coverage, uncertainty, poses
    in space, the pictures with their corners where they are still there, and the cross-check. With --plots
    its charts are written as PNG, SVG or PDF; with both -o and --plots, both.
    """
    from camcal.data.writing import check_writable

    page = output or (None if plots else report.with_suffix(".html"))
    if page is not None:
        check_writable(page, options["force"])
    from camcal.report.loading import from_document
    from camcal.report.yaml import read_document
    from camcal.schema import check

    found = read_document(report)
    check(found, str(report))
    solution = from_document(found, str(report))
    if page is not None:
        from camcal.data.writing import atomic_write
        from camcal.report.html.page import page as make

        atomic_write(page, make(found, solution, str(report)), options["force"])
        note(f"Page written to {page}.")
    if plots is not None:
        from camcal.report.charts.files import write_charts

        written = write_charts(solution, plots, options["plot_format"], options["force"])
        note(f"{len(written)} charts written to {plots}.")
