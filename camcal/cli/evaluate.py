"""`camcal evaluate`: how well a known camera explains new points or pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from camcal.cli.options import options
from camcal.cli.verbosity import verbosity_options


@click.command("evaluate")
@click.argument("camera", type=click.Path(path_type=Path), metavar="CAMERA")
@click.argument("data", nargs=-1, required=True, metavar="POINTS|IMAGES...")
@options("evaluate")
@verbosity_options
@click.pass_context
def command(ctx: click.Context, camera: Path, data: tuple[str, ...], **options: Any) -> int:
    """Judge a camera on data that it was not calibrated with.

    CAMERA is a camera file of any format (`camcal list formats`). Its intrinsics stay as they are, the pose of
    each view is fitted anew, and what remains is reported as after a calibration.
    """
    from camcal.cli.job import deliver_solution, output_is_free, read_data

    output_is_free(options)
    from camcal.assess.known_camera import evaluate
    from camcal.plan.start import leave_out_unusable
    from camcal.report.document import load_camera

    known = load_camera(camera)
    found = leave_out_unusable(read_data(data, options))
    solution = evaluate(known, found, options["robust"], options["seed"])
    return deliver_solution(ctx, solution, options)
