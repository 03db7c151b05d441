"""`camcal evaluate`: how well a known camera fits new points or pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from camcal.cli.options import options
from camcal.cli.verbosity import note, verbosity_options


@click.command("evaluate")
@click.argument("camera", type=click.Path(path_type=Path), metavar="CAMERA")
@click.argument("data", nargs=-1, required=True, metavar="POINTS|IMAGES...")
@options("evaluate")
@verbosity_options
@click.pass_context
def command(ctx: click.Context, camera: Path, data: tuple[str, ...], **options: Any) -> int:
    """Test a camera on data that it was not calibrated with.

    CAMERA is a camera file of any format (`camcal list formats`). Its intrinsics are held, the pose of each
    view is refitted (four points are enough), and the residuals are reported as after a calibration: graded by
    comparison with the residuals in the camera's own report, with warnings for exchanged axes and pictures of
    another size. For a rig, a table names the camera of each point in a column `camera`, or the pictures of
    each camera are given by its name (left=FOLDER right=FOLDER), and each view has one pose for all cameras.
    With --lines the data are straight lines, and the report states how straight they become. With --natural the
    data are pictures of arbitrary scenes by two cameras of a rig (left=PICTURES right=PICTURES), and the report
    states the vertical disparities, which --max-rms then limits.
    """
    from camcal.cli.job import command_line, deliver_solution, output_is_free, read_data

    output_is_free(options)
    if options["natural"]:
        return _natural(camera, data, options, command_line(ctx))
    if options["lines"]:
        return _straightness(camera, data, options, command_line(ctx))
    from camcal.plan.known_camera import evaluate
    from camcal.plan.run import usable
    from camcal.report.loading import load_camera, promise_of
    from camcal.report.opening import is_rig

    if is_rig(camera):
        return _rig(ctx, camera, data, options)
    known = load_camera(camera, options["image_size"])
    found = usable(read_data(data, options), known=True)
    solution = evaluate(known, found, options["robust"], options["seed"], promise_of(camera))
    return deliver_solution(ctx, solution, options)


def _rig(ctx: click.Context, camera: Path, data: tuple[str, ...], options: dict[str, Any]) -> int:
    """Evaluate a rig: one pose of the board per instant, for all its cameras together."""
    from camcal.cli.rig import deliver_rig, read_views
    from camcal.plan.known_rig import evaluate_rig
    from camcal.report.opening import load_rig_cameras

    rig = load_rig_cameras(camera)
    sizes = {n: c.image_size for n, c in rig.cameras.items() if c.image_size is not None}
    views, _ = read_views(data, {**options, "image_size": {"": options["image_size"]} | sizes}, least=1)
    solution = evaluate_rig(rig, views, options["robust"], options["seed"])
    return deliver_rig(ctx, solution, options)


def _straightness(camera: Path, data: tuple[str, ...], options: dict[str, Any], words: list[str]) -> int:
    from camcal.cli.lines import tables
    from camcal.cli.results import deliver
    from camcal.report.lines import evaluation
    from camcal.report.loading import load_camera

    found = evaluation(load_camera(camera), data, words)
    deliver(found, options, "Report", lambda: tables(found))
    return 0


def _natural(camera: Path, data: tuple[str, ...], options: dict[str, Any], words: list[str]) -> int:
    from camcal.cli.job import GATE_FAILED
    from camcal.cli.results import deliver
    from camcal.report.stereo import natural, natural_table

    found = natural(camera, data, options["max_rms"], words, options["fail_on"])
    for warning in found["warnings"]:
        note(f"{warning['message']} {warning['hint']}")
    for failure in found["failures"]:
        note(f"{failure}.")
    deliver(found, options, "Report", lambda: natural_table(found["natural"]))
    return GATE_FAILED if found["verdict"] == "fail" else 0
