"""`camcal hand-eye`: a camera on a robot's hand, or beside the robot."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from camcal.cli.options import options, resolved_options
from camcal.cli.verbosity import note, verbosity, verbosity_options
from camcal.settings.kinds import is_report

if TYPE_CHECKING:
    from camcal.plan.solution import RigSolution, Solution


@click.command("hand-eye")
@click.argument("data", nargs=-1, required=True, metavar="IMAGES|REPORT...")
@options("hand-eye")
@verbosity_options
@click.pass_context
def command(ctx: click.Context, data: tuple[str, ...], **options: Any) -> int:
    """Find where a camera sits on a robot's hand, or beside the robot.

    IMAGES are pictures of a board, as for `camcal checkerboard`; REPORT is what `checkerboard`, `evaluate` or
    `rig` wrote for them. The noise of the pictures and of the robot is estimated.
    """
    from camcal.cli.job import GATE_FAILED, command_line, output_is_free
    from camcal.cli.output import console
    from camcal.cli.results import deliver
    from camcal.report.hand_eye import hand_eye, read_times
    from camcal.report.hand_eye_table import summary, tables

    output_is_free(options)
    from camcal.data.robot_poses import read_robot_poses

    robot = read_robot_poses(options["poses"], options["rotation"])
    times = None if options["times"] is None else read_times(options["times"])
    solution = replace(_solution(data, options), options=resolved_options(ctx))
    names = ("setup", "inverse", "poses_unit", "max_offset", "robust", "crosscheck")
    found = hand_eye(solution, robot, times=times, **{name: options[name] for name in names})
    if found.section["rotation"] != robot.form.name:
        form = found.section["rotation"]
        note(f"The rotations are read as {form}: that fits far better. To select it: --rotation {form}")
    if options["setup"] is None:
        note(f"The set-up is {found.setup}: that fits far better. To select it: --setup {found.setup}")
    report = found.document(command_line(ctx))
    if verbosity() >= 0:
        console(stderr=True).print(summary(report))
    deliver(report, options, "Report", lambda: tables(report))
    return GATE_FAILED if report["verdict"] == "fail" else 0


def _solution(data: tuple[str, ...], options: dict[str, Any]) -> Solution | RigSolution:
    """The calibration of the pictures: read from a report, or computed."""
    if len(data) == 1 and is_report(data[0]):
        from camcal.report.hand_eye import load_calibration

        return load_calibration(Path(data[0]))
    from camcal.cli.inputs import refuse_tables
    from camcal.cli.job import read_pictures

    refuse_tables(data)
    found = read_pictures(data, options)
    if options["camera"] is not None:
        from camcal.plan.known_camera import evaluate
        from camcal.plan.run import usable
        from camcal.report.loading import load_camera

        known = load_camera(options["camera"], options["image_size"])
        return evaluate(known, usable(found), options["robust"], options["seed"])
    from camcal.plan.calibrate import calibrate

    given = {name: options[name] for name in ("model", "robust", "crosscheck", "seed")}
    return calibrate(found, board_shape="auto", **given)
