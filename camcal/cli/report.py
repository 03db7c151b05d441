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

    The page needs no network and no other file: verdict, parameters, residuals, coverage, uncertainty, poses in
    space, the pictures with their corners if they still exist, and the cross-check. With --plots, its charts
    are written as PNG, SVG or PDF; with both -o and --plots, both are written.
    """
    from camcal.data.writing import check_writable

    page = output or (None if plots else report.with_suffix(".html"))
    if page is not None:
        check_writable(page, options["force"])
    from camcal.report.yaml import read_document
    from camcal.schema import check

    found = read_document(report)
    check(found, str(report))
    from camcal.report.rig_loading import is_rig_report  # loads most of the program

    if is_rig_report(found):
        _rig(found, report, page, plots, options)
    else:
        _camera(found, report, page, plots, options)


def _camera(
    found: dict[str, Any], report: Path, page: Path | None, plots: Path | None, options: dict[str, Any]
) -> None:
    from camcal.report.html.page import page as make
    from camcal.report.loading import from_document

    solution = from_document(found, str(report))
    if page is not None:
        _write(page, make(found, solution, str(report)), options["force"])
    if plots is not None:
        _write_charts(solution, plots, options)


def _rig(
    found: dict[str, Any], report: Path, page: Path | None, plots: Path | None, options: dict[str, Any]
) -> None:
    """The page of a rig; the charts of each camera in a folder of its name."""
    from camcal.plan.rig_cameras import solution_within
    from camcal.report.html.rig import page as make
    from camcal.report.rig_loading import from_document

    solution = from_document(found, str(report))
    if page is not None:
        _write(page, make(found, solution, str(report)), options["force"])
    if plots is not None:
        for name in solution.rig.cameras:
            _write_charts(solution_within(solution, name), plots / name, options)


def _write(page: Path, text: str, force: bool) -> None:
    from camcal.data.writing import atomic_write

    atomic_write(page, text, force)
    note(f"Page written to {page}.")


def _write_charts(solution: Any, folder: Path, options: dict[str, Any]) -> None:
    from camcal.report.charts.files import write_charts

    written = write_charts(solution, folder, options["plot_format"], options["force"])
    note(f"{len(written)} charts written to {folder}.")
