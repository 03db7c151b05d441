"""`camcal detect`: the corners of a target in pictures, as a table that `camcal estimate` reads."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from camcal.cli.options import options
from camcal.cli.verbosity import note, verbosity_options


@click.command("detect")
@click.argument("images", nargs=-1, required=True, metavar="IMAGES...")
@options("detect")
@verbosity_options
def command(images: tuple[str, ...], output: Path, force: bool, **options: Any) -> int:
    """Find a target in pictures and write its corners.

    IMAGES are folders, files, quoted patterns, zip archives or films, as for `camcal checkerboard`. The table
    has the format that `camcal estimate` reads from any detector; give it the picture size with --image-size.
    """
    from camcal.cli.inputs import refuse_tables
    from camcal.cli.job import read_pictures, save_detections
    from camcal.data.writing import check_writable

    refuse_tables(images)
    check_writable(output, force)
    found = read_pictures(images, options, calibrated=False)
    save_detections(found, output, force)
    if found.image_size is not None:
        note("To calibrate: camcal estimate {} --image-size {}x{}".format(output, *found.image_size))
    for skipped in found.skipped:
        note(f"{skipped.id}: {skipped.reason}")
    return 0
