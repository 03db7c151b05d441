"""Output of `camcal track` at the end of its stream."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from camcal.cli.verbosity import note

if TYPE_CHECKING:
    from camcal.track.follow import Summary

SHOWN = 10  #: changes that are listed on the terminal; the report and the log have all
CHANGED = 1  #: the exit code of --fail-on-change


def may_replace(options: dict[str, Any]) -> bool:
    """Return whether outputs may be overwritten: with --force, or for a run with a state file."""
    return options["force"] or (options["state"] is not None and options["state"].is_file())


def deliver(ctx: click.Context, summary: Summary, follower: Any, options: dict[str, Any]) -> int:
    """Summarise the run on stderr, write report and plots; return the exit code."""
    for line in _said(summary):
        note(line)
    failed = options["fail_on_change"] and summary.change_count > 0
    if options["report"] is not None:
        _write_report(ctx, summary, follower, options, failed)
    if options["plots"] is not None:
        from camcal.track.plots import draw

        reference = None if options["reference"] is None else reference_matrix(options["reference"])
        for path in draw(options["output"], options["plots"], reference, may_replace(options)):
            note(f"Plot written to {path}.")
    return CHANGED if failed else 0


def _said(summary: Summary) -> Iterator[str]:
    counts = ", ".join(f"{count} {status}" for status, count in summary.statuses.items())
    yield f"{summary.frames} frames ({counts}); {summary.used} of {summary.points} points used."
    if summary.ignored:
        many = (
            "frames came late or twice and were"
            if summary.ignored > 1
            else "frame came late or twice and was"
        )
        yield f"{summary.ignored} {many} ignored."
    shown = [c.message for c in summary.changes[:SHOWN]]
    more = summary.change_count - len(shown)
    yield f"Changes: {summary.change_count}" + ("." if not shown else ":")
    yield from (f"  {message}" for message in shown)
    if more > 0 and shown:
        yield f"  and {more} more"


def _write_report(
    ctx: click.Context, summary: Summary, follower: Any, options: dict[str, Any], failed: bool
) -> None:
    from camcal.cli.job import command_line
    from camcal.cli.options import resolved_options
    from camcal.report.head import head
    from camcal.report.plain import plain
    from camcal.report.yaml import save
    from camcal.track.summary import document

    made = {
        **head(command_line(ctx)),
        "inputs": {"image_size": None, "frames": summary.frames, "points": summary.points},
        "options": resolved_options(ctx),
        **document(summary, follower.estimator, options["method"]),
        "verdict": "fail" if failed else "pass",
    }
    save(plain(made), options["report"], may_replace(options))
    note(f"Report written to {options['report']}.")


def reference_matrix(path: Path) -> Any:
    """The projection matrix (3, 4) of a report."""
    import numpy as np

    from camcal.errors import DataError
    from camcal.report.yaml import read_document

    matrix = np.array(read_document(path).get("projection_matrix") or (), float)
    if matrix.shape != (3, 4):
        raise DataError(
            f"'{path}' holds no projection_matrix.", "Give a report of a single view or of `track`."
        )
    return matrix
