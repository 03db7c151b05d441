"""`camcal wand`: several cameras from a bar of known length."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from camcal.cli.options import options
from camcal.cli.verbosity import verbosity_options


@click.command("wand")
@click.argument("tracks", type=click.Path(path_type=Path), metavar="TRACKS")
@options("wand")
@verbosity_options
@click.pass_context
def command(ctx: click.Context, tracks: Path, **options: Any) -> int:
    """Calibrate several cameras from a bar of known length that is moved through the volume they see.

    TRACKS is a table camera,view,point,u,v (the same view is the same instant, the points are the markers of
    the bar), or the digitised points of DLTdv, Argus and easyWand (pt1_cam1_X, ...). Cameras given by --cameras
    are held; for the others the focal length, the lens and, if determined, the principal point are estimated.
    The report contains a rig, for `camcal triangulate` and `camcal convert --to dlt`.
    """
    from camcal.cli.job import command_line, output_is_free
    from camcal.cli.results import deliver_route

    output_is_free(options)
    from camcal.report.wand import report

    names = ("bar", "bar_sigma", "cameras", "model", "fix", "image_size", "seed", "crosscheck")
    found = report(tracks, **{name: options[name] for name in names}, command=command_line(ctx))
    return deliver_route(found, options, _tables)


def _tables(found: dict[str, Any]) -> Any:
    from rich.console import Group
    from rich.text import Text

    from camcal.cli.output import table

    made, fit = found["wand"], found["fit"]
    rows = [
        [f"{name}.{n}", p["value"], p["sigma"]]
        for name, camera in found["cameras"].items()
        for n, p in camera["parameters"].items()
    ]
    title = f"{made['instants_used']} of {made['instants']} instants, rms {fit['rms_point']:.4g} px"
    distances = [[name, b["value"], b["sigma"]] for name, b in found["rig"]["baselines"].items()]
    length = made["length"]
    said = "distances of cameras"
    if length["std"] is not None:
        said += f"; bars triangulated: {length['mean']:.6g} +- {length['std']:.2g} of {length['given']:g}"
    return Group(
        table(["parameter", "value", "sigma"], rows, title),
        Text(""),
        table(["", "value", "sigma"], distances, said),
    )
