"""The amount of output on stderr: `-q`, default, `-v`, `-vv`."""

from __future__ import annotations

from typing import Any

import click


def count_verbosity(ctx: click.Context, param: click.Parameter, value: int) -> int:
    """Add -v and -q, wherever they are on the command line, to the verbosity of the run."""
    state = ctx.find_root().ensure_object(dict)
    state["verbosity"] = state.get("verbosity", 0) + (-value if param.name == "quiet" else value)
    return value


def verbosity_options(function: Any) -> Any:
    """Add `-v/-vv` and `-q`; the group and every command have them, so that their position does not matter."""
    function = click.option(
        "-q", "--quiet", count=True, expose_value=False, is_eager=True, callback=count_verbosity,
        help="Write only errors to stderr.",
    )(function)  # fmt: skip
    return click.option(
        "-v", "--verbose", count=True, expose_value=False, is_eager=True, callback=count_verbosity,
        help="Write more to stderr; -vv also shows the traceback of an internal error.",
    )(function)  # fmt: skip


def verbosity() -> int:
    """Return the count of -v minus the count of -q of the running command."""
    ctx = click.get_current_context(silent=True)
    return ctx.find_root().ensure_object(dict).get("verbosity", 0) if ctx else 0


def note(message: str, level: int = 0) -> None:
    """Write a note to stderr; `level` 0 is suppressed by -q, 1 needs -v."""
    if verbosity() >= level:
        from camcal.system.text import message as shown

        click.echo(shown(message), err=True)
