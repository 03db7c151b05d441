"""`camcal lines`: a lens from straight lines."""

from __future__ import annotations

from typing import Any

import click

from camcal.cli.options import options
from camcal.cli.verbosity import verbosity_options


@click.command("lines")
@click.argument("data", nargs=-1, required=True, metavar="IMAGES|LINES...")
@options("lines")
@verbosity_options
@click.pass_context
def command(ctx: click.Context, data: tuple[str, ...], **options: Any) -> int:
    """Find the distortion of a lens from straight lines, without a target.

    The lines are found in pictures (taut strings, printed grids, edges of buildings and boards), or given in
    tables line,u,v[,view]. Lines do not determine the focal length: it is held at the longer side of the
    picture, or at --fix fx=VALUE.
    """
    from camcal.cli.job import command_line, output_is_free
    from camcal.cli.results import deliver_route

    output_is_free(options)
    from camcal.report.lines import report

    given = {name: options[name] for name in ("model", "image_size", "fix", "robust", "crosscheck")}
    found = report(data, **given, command=command_line(ctx))
    return deliver_route(found, options, tables)


def tables(found: dict[str, Any]) -> Any:
    """Return the tables shown for a report with `straightness`."""
    from rich.console import Group
    from rich.text import Text

    from camcal.cli.output import table

    made = found["straightness"]
    rows = [[name, made[name]["rms"], made[name]["max"]] for name in ("before", "after", "in_picture")]
    title = f"{len(made['lines'])} of {made['lines_given']} lines, distances from straight, px"
    parameters = [[n, p["value"], p["sigma"]] for n, p in found["camera"]["parameters"].items()]
    return Group(
        table(["", "rms", "max"], rows, title), Text(""), table(["parameter", "value", "sigma"], parameters)
    )
