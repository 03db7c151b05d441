"""`camcal checkerboard`: a camera from pictures of a board."""

from __future__ import annotations

from typing import Any

import click

from camcal.cli.options import board_options, calibration_options, report_options
from camcal.cli.verbosity import verbosity_options


@click.command("checkerboard")
@click.argument("images", nargs=-1, required=True, metavar="IMAGES...")
@board_options
@calibration_options
@report_options
@verbosity_options
@click.pass_context
def command(ctx: click.Context, images: tuple[str, ...], **options: Any) -> int:
    """Calibrate a camera from pictures of a checkerboard.

    IMAGES are folders, files or quoted patterns. The size of the board is found from the pictures.
    """
    from camcal.cli.job import calibrate_and_report, output_is_free, read_pictures

    output_is_free(options)
    return calibrate_and_report(ctx, read_pictures(images, options), options)
