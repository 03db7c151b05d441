"""`camcal checkerboard`: a camera from pictures of a board."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from camcal.cli.options import board_options, calibration_options, option, report_options
from camcal.cli.verbosity import verbosity_options


@click.command("checkerboard")
@click.argument("images", nargs=-1, required=True, metavar="IMAGES...")
@board_options
@option(
    "--save-corners", type=click.Path(path_type=Path), metavar="FILE",
    help="Write the corners too, as the table that `camcal detect` makes.",
)  # fmt: skip
@calibration_options
@report_options
@verbosity_options
@click.pass_context
def command(ctx: click.Context, images: tuple[str, ...], save_corners: Path | None, **options: Any) -> int:
    """Calibrate a camera from pictures of a checkerboard or another target.

    IMAGES are folders, files or quoted patterns. What target it is, and its size, is found from the pictures
    where --target and --board do not say it.
    """
    from camcal.cli.job import calibrate_and_report, output_is_free, read_pictures, save_detections

    output_is_free(options)
    if save_corners is not None:
        output_is_free({**options, "output": save_corners})
    found = read_pictures(images, options)
    if save_corners is not None:
        save_detections(found, save_corners, options["force"])
    return calibrate_and_report(ctx, found, options)
