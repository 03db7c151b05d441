"""A command that does what a test asks for: fails in a given way, or prints its resolved options as JSON."""

import json
import time

import click

from camcal import errors
from camcal.cli.options import options, resolved_options
from camcal.cli.verbosity import verbosity_options

FAILURES = {
    "camcal": errors.CamcalError("a gate failed.", "one thing to try\nand another"),
    "usage": errors.UsageError("a contradiction.", "leave one out"),
    "data": errors.DataError("2 images were found; 3 are needed."),
    "estimation": errors.EstimationError("degenerate.", "tilt the board"),
    "click": click.UsageError("Wrong use"),
    "missing-file": FileNotFoundError(2, "No such file or directory", "there.csv"),
    "interrupt": KeyboardInterrupt(),
    "abort": click.Abort(),
    "bug": ZeroDivisionError("division by zero\nsecond line"),
    "end-of-file": EOFError("from a library, not from the user"),
    "memory": MemoryError(),
    "full": OSError(28, "No space left on device"),
    "nameless-os-error": OSError("from a library, not from the system"),
}


@click.command("toy")
@click.argument("what", default="show")
@options("toy")
@verbosity_options
@click.pass_context
def command(ctx, what, **values):
    """Do what a test asks for."""
    if what == "show":
        click.echo(json.dumps(resolved_options(ctx), default=str))
        return 0
    if what == "sleep":
        click.echo("ready")
        time.sleep(60)
    if what == "gate":
        return 1
    raise FAILURES[what]
