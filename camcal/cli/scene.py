"""`camcal scene`: a camera from one picture of orthogonal lines."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from camcal.cli.options import options
from camcal.cli.verbosity import verbosity_options


@click.command("scene")
@click.argument("picture", type=click.Path(path_type=Path), metavar="IMAGE|LINES")
@options("scene")
@verbosity_options
@click.pass_context
def command(ctx: click.Context, picture: Path, **options: Any) -> int:
    """Find the focal length, the principal point and the attitude from one picture of a room or a street.

    Lines in three orthogonal directions determine both, lines in two directions only the focal length. They are
    found in the picture, or given as a table line,u,v with --image-size. Undetermined parameters are held with
    a warning, or cause an error.
    """
    from camcal.cli.job import command_line, output_is_free
    from camcal.cli.results import deliver_route

    output_is_free(options)
    from camcal.report.scene import report

    given = {name: options[name] for name in ("model", "fix", "image_size", "seed")}
    found = report(picture, **given, command=command_line(ctx))
    return deliver_route(found, options, _table)


def _table(found: dict[str, Any]) -> Any:
    from rich.console import Group
    from rich.text import Text

    from camcal.cli.output import table

    rows = [
        [" ".join(f"{x:.4f}" for x in p["direction"]), _where(p), len(p["lines"])]
        for p in found["scene"]["vanishing_points"]
    ]
    parameters = [[n, p["value"], p["sigma"]] for n, p in found["camera"]["parameters"].items()]
    return Group(
        table(["direction", "vanishing point", "lines"], rows, f"{found['scene']['kind']} directions"),
        Text(""),
        table(["parameter", "value", "sigma"], parameters),
    )


def _where(point: dict[str, Any]) -> str:
    if point["pixel"] is None:
        return "at infinity" if point["at_infinity"] else "outside the lens"
    return " ".join(f"{x:.1f}" for x in point["pixel"])
