"""Results that are plain documents: written to a file, shown on stdout, and confirmed in a line."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from camcal.cli.output import emit
from camcal.cli.verbosity import note


def deliver_route(
    found: dict[str, Any], options: Mapping[str, Any], as_table: Callable[[dict[str, Any]], Any]
) -> int:
    """Show the warnings of a route's report, deliver it, and return the exit code; see `deliver`."""
    from camcal.cli.job import GATE_FAILED

    for warning in found["warnings"]:
        note(f"{warning['message']} {warning['hint']}")
    deliver(found, options, "Report", lambda: as_table(found))
    return GATE_FAILED if found["verdict"] == "fail" else 0


def deliver(
    found: dict[str, Any], options: Mapping[str, Any], what: str, as_table: Callable[[], Any]
) -> None:
    """Write a document to `--output` if given, and show it on stdout in `--format`.

    Parameters
    ----------
    found : dict
        What `camcal.report.plain` takes.
    options : mapping
        With `output`, `force` and `format`.
    what : str
        What was written, for the line on stderr: "Report".
    as_table : callable
        See `camcal.cli.output.emit`.
    """
    from camcal.report.plain import plain
    from camcal.report.yaml import save

    if options["output"] is not None:
        save(plain(found), options["output"], options["force"])
    emit(found, options["format"], as_table)
    if options["output"] is not None:
        note(f"{what} written to {options['output']}.")
