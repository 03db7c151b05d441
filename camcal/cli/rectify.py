"""`camcal rectify`: pictures of two cameras in which a point lies in the same row of both."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from camcal.cli.options import options
from camcal.cli.verbosity import note, verbosity_options
from camcal.system.text import counted

FILE = click.Path(path_type=Path)


@click.command("rectify")
@click.argument("rig", type=FILE, metavar="RIG")
@click.argument("pictures", nargs=-1, required=True, metavar="NAME=PICTURES...")
@options("rectify")
@verbosity_options
@click.pass_context
def command(ctx: click.Context, rig: Path, pictures: tuple[str, ...], **options: Any) -> int:
    """Rectify pictures of two cameras, so that a point lies in the same row of both.

    RIG holds cameras with their poses: a report of `camcal rig`, or a stereo file of OpenCV, Kalibr, MATLAB and
    others. NAME=PICTURES are two of its cameras, each with a picture or a folder, such as left=left.png
    right=right.png. FOLDER receives the rectified pictures, side-by-side views with rows drawn (rows-....png),
    the maps (maps.npz: left_u, left_v, right_u, right_v, for cv2.remap) and rectification.yaml: R1, R2, P1, P2
    and Q under OpenCV's names. For a pair with one camera above the other, points lie in the same column.
    """
    from camcal.cli.job import command_line
    from camcal.cli.output import emit, progress
    from camcal.report.rectified import Writer, table
    from camcal.report.stereo import load_pair

    layout = {name: options[name] for name in ("alpha", "size", "projection")}
    pair = load_pair(rig, pictures, **layout)
    writer = Writer(pair, options["output"], options["interpolation"], options["force"])
    with progress("rectifying") as show:
        for index in range(len(pair.pictures)):
            writer.write(index)
            show(index + 1, len(pair.pictures))
    found = writer.finish(rig, options["alpha"], command_line(ctx))
    emit(found, options["format"], lambda: table(found))
    made = found["rectification"]
    note(f"{counted(len(pair.pictures), made['direction'] + ' pair')} written to {options['output']}.")
    return 0
