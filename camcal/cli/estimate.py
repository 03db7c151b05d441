"""`camcal estimate`: a camera from points and their images."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from camcal.cli.options import options, settle
from camcal.cli.verbosity import verbosity_options

FILE = click.Path(path_type=Path)


@click.command("estimate")
@click.argument("points", nargs=-1, type=FILE, metavar="POINTS...")
@options("estimate")
@verbosity_options
@click.pass_context
def command(ctx: click.Context, points: tuple[Path, ...], **options: Any) -> int:
    """Calibrate a camera from points of known position and where they were seen.

    POINTS are tables with the columns view, X, Y, Z, u, v (a header may name them otherwise and add sigma
    and id), .npz files, or files of other programs: corners of mrcal (.vnl), OpenCV's image_points,
    PhotonVision's observations, OpenDroneMap's gcp_list.txt. Several files are several views, unless they
    have a view column. With --distortion the lens that `camcal lines` found is held, and the joint solution is
    reported for comparison.
    """
    from camcal.cli.inputs import refuse_pictures
    from camcal.cli.job import calibrate_and_report, in_order, output_is_free

    output_is_free(options)
    refuse_pictures(points)
    points = in_order(points, options, ctx)
    from camcal.data.points import read_points

    given = {name: options[name] for name in ("points3d", "points2d", "image_size", "board")}
    square = options["square"]
    if square is not None:
        given["square"] = square.value
    data = read_points(*points, **given)
    settle(ctx, options, board_shape=data.usual_board_shape)
    if options["distortion"] is None:
        return calibrate_and_report(ctx, data, options)
    from camcal.cli.distortion_first import held_options

    options, section = held_options(options["distortion"], data, options)
    return calibrate_and_report(ctx, data, options, sections={"distortion_first": section})
