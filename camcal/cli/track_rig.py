"""`camcal track --rig`: test whether the cameras of a rig have moved."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from camcal.cli.track_results import CHANGED
from camcal.cli.verbosity import note
from camcal.settings.tracking import METHOD, RUN, TrackOptions

if TYPE_CHECKING:
    from camcal.plan.rig_drift import Followed

#: of the options of `camcal track`, those that a rig has a use for
TAKEN = frozenset(("rig", "false_alarm", "fail_on_change", "output", "report", "force", "config"))


def follow_rig(ctx: click.Context, frames: tuple[str, ...], options: dict[str, Any]) -> int:
    """Monitor a rig; return the exit code."""
    from camcal.cli.job import command_line
    from camcal.cli.options import resolved_options
    from camcal.cli.rig import read_views
    from camcal.data.writing import atomic_write, check_writable
    from camcal.plan.rig_drift import follow
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
    views, _ = read_views(frames, {**options, "image_size": {}})
    found = follow(rig, views, options["false_alarm"])
    if options["output"] is None:
        click.echo(csv_text(found), nl=False)
    else:
        atomic_write(options["output"], csv_text(found), options["force"])
        note(f"Table written to {options['output']}.")
    _say(found)
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


def _check(ctx: click.Context) -> None:
    """Raise an error for options that would be ignored."""
    from camcal.errors import UsageError

    known = {o.name: o for o in (METHOD, *TrackOptions.command_line(), *RUN)}
    for name, option in known.items():
        given = ctx.get_parameter_source(name) in (ParameterSource.COMMANDLINE, ParameterSource.ENVIRONMENT)
        if given and name not in TAKEN:
            raise UsageError(f"{option.long} has no effect with --rig.", "Leave it out.")


def _say(found: Followed) -> None:
    follower = found.follower
    statuses = Counter({r.instant: r.status for r in follower.rows}.values())
    counts = ", ".join(f"{count} {status}" for status, count in statuses.items())
    note(
        f"{sum(statuses.values())} instants ({counts}) of {len(found.names)} cameras; {found.points} points."
    )
    if found.alone:
        note(f"{len(found.alone)} instants were seen by one camera only.")
    note(f"Changes: {len(follower.changes)}" + (":" if follower.changes else "."))
    for knock in follower.changes:
        note(f"  {knock.message}")
