"""`camcal checkerboard`, alias `images`: a camera from pictures of a target."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import click

from camcal.cli.options import options
from camcal.cli.verbosity import verbosity_options


@click.command("checkerboard")
@click.argument("images", nargs=-1, required=True, metavar="IMAGES...")
@options("checkerboard")
@verbosity_options
@click.pass_context
def command(ctx: click.Context, images: tuple[str, ...], save_corners: Path | None, **options: Any) -> int:
    """Calibrate a camera from pictures of a checkerboard or another target.

    IMAGES are folders, files, quoted patterns, zip archives, films (of which frames are chosen, named
    movie.mp4#123) or numbered frames (frame_%04d.png). The target and its size are recognised from the pictures
    unless --target or --board is given.
    """
    from camcal.cli.inputs import refuse_tables
    from camcal.cli.job import calibrate_and_report, in_order, output_is_free, read_pictures

    refuse_tables(images)
    output_is_free({**options, "save_corners": save_corners}, "save_corners")
    images = in_order(images, options, ctx)
    return calibrate_and_report(ctx, read_pictures(images, options), options, save_corners)


#: the same under the name for targets of any kind
images = copy.copy(command)
images.name = "images"
