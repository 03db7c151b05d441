"""`camcal rig`: several cameras that are mounted to each other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from camcal.cli.options import options, resolved_options, settle
from camcal.cli.verbosity import note, verbosity_options
from camcal.settings.kinds import is_report

if TYPE_CHECKING:
    from camcal.data.rig_table import RigViews
    from camcal.plan.solution import RigSolution


@click.command("rig")
@click.argument("inputs", nargs=-1, required=True, metavar="TABLE | NAME=IMAGES...")
@options("rig")
@verbosity_options
@click.pass_context
def command(ctx: click.Context, inputs: tuple[str, ...], **options: Any) -> int:
    """Calibrate two or more cameras and their relative poses.

    TABLE has the columns camera, view, X, Y, Z, u, v (and sigma, id); the same view is the same instant. Or each
    camera is given by a name and its pictures: left=FOLDER right='imgs/right*.jpg'. Pictures of the same instant have
    the same name, or the same number in it. All intrinsics, relative poses and boards are estimated together.
    """
    from camcal.cli.job import in_order, output_is_free
    from camcal.plan.rig import calibrate_rig
    from camcal.settings.rig import NOT_OF_RIGS, RigOptions

    output_is_free(options)
    views, of_pictures = read_views(in_order(inputs, options, ctx), options)
    settle(ctx, options, board_shape=views.usual_board_shape)
    given = {o.name: options[o.name] for o in RigOptions.command_line(*NOT_OF_RIGS)}
    if is_report(given["board_shape"]):
        from camcal.report.board import on_known_board

        known = {n: on_known_board(part, given["board_shape"]) for n, part in views.parts.items()}
        views, given["board_shape"] = replace(views, parts=known), "flat"
    refine_points = options["refine_corners"] if of_pictures else False
    solution = calibrate_rig(views, on_event=_tell, refine_points=refine_points, **given)
    return deliver_rig(ctx, solution, options)


def read_views(inputs: tuple[str, ...], options: dict[str, Any], least: int = 2) -> tuple[RigViews, bool]:
    """The observations of the cameras, and whether they come from pictures.

    Raises
    ------
    UsageError
        If the words are neither one table nor cameras with their pictures.
    """
    from camcal.data.rig_table import RigViews, read_rig

    folders = cameras_with_pictures(inputs, least)
    if folders is None:
        return RigViews.of(read_rig(inputs[0], options["image_size"], least), least), False
    return _detected(folders, options), True


def cameras_with_pictures(inputs: tuple[str, ...], least: int = 2) -> dict[str, list[str]] | None:
    """The pictures of each camera by the words NAME=PICTURES; None where the only word is a table.

    Raises
    ------
    UsageError
        If the words are neither.
    """
    from camcal.errors import UsageError
    from camcal.settings.rig import split_camera

    pairs = [(split_camera(text), text) for text in inputs]
    if len(inputs) == 1 and (pairs[0][0] is None or Path(inputs[0]).is_file()):
        return None
    folders: dict[str, list[str]] = {}
    for pair, text in pairs:
        if pair is None:
            raise UsageError(
                f"'{text}' is not the pictures of a camera; NAME=FOLDER is needed, or one table alone.",
                "Try: camcal rig left=FOLDER right=FOLDER",
            )
        folders.setdefault(pair[0], []).append(pair[1])
    if len(folders) < least:
        raise UsageError(
            f"a rig has two or more cameras; '{next(iter(folders))}' is one.", "Try: left=FOLDER right=FOLDER"
        )
    return folders


def _detected(folders: Mapping[str, list[str]], options: dict[str, Any]) -> RigViews:
    from camcal.cli.job import detection_events, search_options
    from camcal.cli.output import progress
    from camcal.detect.rig_images import detect_rig
    from camcal.system.processes import keep_freed_memory

    keep_freed_memory()
    with progress("reading pictures") as show:
        return detect_rig(folders, on_event=detection_events(show), **search_options(options))


def _tell(event: str, details: Mapping[str, Any]) -> None:
    if event == "camera":
        note("camera {name} by itself: {model}, rms {rms_point:.4g} px".format(**details))


def deliver_rig(ctx: click.Context, solution: RigSolution, options: dict[str, Any]) -> int:
    """Write the report and the rig, show and summarise them; return the exit code."""
    from camcal.cli.job import command_line, delivered
    from camcal.report.rig import document
    from camcal.report.rig_table import tables

    solution = replace(solution, options=resolved_options(ctx))
    command = command_line(ctx)
    return delivered(document(solution, command=command), options, solution.rig, command, tables)
