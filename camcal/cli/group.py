"""The `camcal` group: commands loaded on first use, verbosity, `--version`, "did you mean"."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import click

from camcal.cli import COMMANDS
from camcal.cli.verbosity import verbosity_options
from camcal.errors import UsageError
from camcal.registry import load, suggestion
from camcal.version import __version__

CONTEXT = {"help_option_names": ["-h", "--help"], "max_content_width": 100}


class LazyGroup(click.Group):
    """A group whose commands are in a table name -> ("module:command", one-line help)."""

    def __init__(self, *args: Any, table: Mapping[str, tuple[str, str]], **kwargs: Any):
        super().__init__(*args, **kwargs)
        self.table = table

    def list_commands(self, ctx: click.Context) -> list[str]:
        """List the commands in the order of the table, which puts the main jobs first."""
        return list(self.table)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import the command, or return None if the table has no such name."""
        return load(self.table[cmd_name][0]) if cmd_name in self.table else None

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of commands from the table alone."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, text) in self.table.items()])

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Show the help for an empty command line and exit with code 2, with any version of click."""
        if not args and not ctx.resilient_parsing:
            click.echo(self.get_help(ctx), err=True)
            ctx.exit(2)
        return super().parse_args(ctx, args)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command; for an unknown one suggest the closest name."""
        name = args[0]
        if name not in self.table and not name.startswith("-") and not ctx.resilient_parsing:
            hint = suggestion(name, self.table) or "camcal --help lists the commands."
            raise UsageError(f"unknown command '{name}'.", hint)
        return super().resolve_command(ctx, args)


@click.group(name="camcal", cls=LazyGroup, table=COMMANDS, context_settings=CONTEXT)
@verbosity_options
@click.version_option(__version__, "-V", "--version", message="camcal %(version)s")
def camcal() -> None:
    """Calibrate cameras from points or pictures; every result is cross-checked with OpenCV.

    The two main jobs are `camcal estimate POINTS` and `camcal checkerboard IMAGES`.
    """
