"""`camcal selfcalib`: a camera from tracks of unknown points."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from camcal.cli.options import options
from camcal.cli.verbosity import note, verbosity_options
from camcal.system.text import counted


@click.command("selfcalib")
@click.argument("data", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="TRACKS|IMAGES...")
@options("selfcalib")
@verbosity_options
@click.pass_context
def command(ctx: click.Context, data: tuple[Path, ...], **options: Any) -> int:
    """Calibrate a camera from points that several views share, without knowing where they are.

    TRACKS is a table view,point,u,v: the same camera in every view, the same name for the same point. In
    IMAGES, two to a hundred of one scene, the tracks are found (SIFT). Motions that leave the focal length
    undetermined (critical motions) are an error.
    """
    from camcal.cli.job import command_line, output_is_free
    from camcal.cli.results import deliver_route

    output_is_free(options)
    from camcal.report.selfcalib import report

    given = {
        name: options[name]
        for name in ("model", "fix", "image_size", "seed", "crosscheck", "save_tracks", "force")
    }
    found = report(data, **given, command=command_line(ctx), said=note)
    return deliver_route(found, options, _table)


def _table(found: dict[str, Any]) -> Any:
    from camcal.cli.output import table

    made, fit = found["selfcalib"], found["fit"]
    rows = [[n, p["value"], p["sigma"], p["start"]] for n, p in found["camera"]["parameters"].items()]
    title = (
        f"{counted(made['views'], 'view')}, {counted(made['points'], 'point')}, rms {fit['rms_point']:.4g} px"
    )
    return table(["parameter", "value", "sigma", "start"], rows, title)
