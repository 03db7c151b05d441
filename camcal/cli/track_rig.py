"""`camcal track --rig`: test whether the cameras of a rig have moved."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from camcal.cli.track_results import CHANGED
from camcal.cli.verbosity import note
from camcal.settings.detection import DetectionOptions
from camcal.settings.tracking import METHOD, RUN, TrackOptions

if TYPE_CHECKING:
    from camcal.plan.rig_drift import Followed
    from camcal.plan.solution import RigSolution

#: of the options of `camcal track`, those that a rig has a use for
TAKEN = frozenset(("rig", "natural", "false_alarm", "fail_on_change", "output", "report", "force", "config"))


def follow_rig(ctx: click.Context, frames: tuple[str, ...], options: dict[str, Any]) -> int:
    """Monitor a rig; return the exit code."""
    from camcal.cli.job import command_line
    from camcal.cli.options import resolved_options
    from camcal.data.writing import atomic_write, check_writable
    from camcal.report.head import head
    from camcal.report.plain import plain
    from camcal.report.rig_drift import csv_text, sections
    from camcal.report.rig_loading import load_rig
    from camcal.report.yaml import save

    _check(ctx)
    for name in ("output", "report"):
        if options[name] is not None:
            check_writable(options[name], options["force"])
    rig = load_rig(options["rig"])
    found = _of_scenes(rig, frames, options) if options["natural"] else _of_boards(rig, frames, options)
    if options["output"] is None:
        click.echo(csv_text(found), nl=False)
    else:
        atomic_write(options["output"], csv_text(found), options["force"])
        note(f"Table written to {options['output']}.")
    _say(found, options["natural"])
    failed = options["fail_on_change"] and bool(found.follower.changes)
    if options["report"] is not None:
        made = {
            **head(command_line(ctx)),
            "options": resolved_options(ctx),
            **sections(rig, found),
            "verdict": "fail" if failed else "pass",
        }
        save(plain(made), options["report"], options["force"])
        note(f"Report written to {options['report']}.")
    return CHANGED if failed else 0


def _of_boards(rig: RigSolution, frames: tuple[str, ...], options: dict[str, Any]) -> Followed:
    from camcal.cli.rig import read_views
    from camcal.plan.rig_drift import follow

    views, _ = read_views(frames, {**options, "image_size": {}})
    return follow(rig, views, options["false_alarm"])


def _of_scenes(rig: RigSolution, frames: tuple[str, ...], options: dict[str, Any]) -> Followed:
    from camcal.cli.output import progress
    from camcal.cli.rig import cameras_with_pictures
    from camcal.detect.rig_scenes import shared_points
    from camcal.plan.natural_drift import follow_scenes, read_shared
    from camcal.plan.rig_drift import require_cameras

    folders = cameras_with_pictures(frames)
    if folders is None:
        return follow_scenes(rig, read_shared(frames[0]), options["false_alarm"])
    require_cameras(rig, folders)
    sizes = {name: camera.image_size for name, camera in rig.rig.cameras.items()}
    with progress("matching pictures") as show:
        instants = shared_points(folders, sizes, options["every"], show)
        return follow_scenes(rig, instants, options["false_alarm"])


def _check(ctx: click.Context) -> None:
    """Raise an error for options that would be ignored."""
    from camcal.errors import UsageError

    if ctx.params["rig"] is None:
        raise UsageError("--natural needs the rig.", "Give the report of `camcal rig`: --rig rig.yaml")
    known = {o.name: o for o in (METHOD, *TrackOptions.command_line(), *RUN)}
    search = (
        {} if not ctx.params["natural"] else {o.name: o for o in DetectionOptions.command_line("keep_frames")}
    )
    for name, option in {**known, **search}.items():
        given = ctx.get_parameter_source(name) in (ParameterSource.COMMANDLINE, ParameterSource.ENVIRONMENT)
        if given and name not in TAKEN and name != "every":
            flag = "--natural" if name in search else "--rig"
            raise UsageError(f"{option.long} has no effect with {flag}.", "Leave it out.")


def _say(found: Followed, natural: bool) -> None:
    follower = found.follower
    statuses = Counter({r.instant: r.status for r in follower.rows}.values())
    counts = ", ".join(f"{count} {status}" for status, count in statuses.items())
    note(
        f"{sum(statuses.values())} instants ({counts}) of {len(found.names)} cameras; {found.points} "
        f"{'matches' if natural else 'points'}."
    )
    if found.alone and natural:
        note(f"{len(found.alone)} instants have no two pictures that share enough points.")
    elif found.alone:
        note(f"{len(found.alone)} instants were seen by one camera only.")
    note(f"Changes: {len(follower.changes)}" + (":" if follower.changes else "."))
    for knock in follower.changes:
        note(f"  {knock.message}")
