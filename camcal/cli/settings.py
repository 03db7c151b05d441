"""Where the value of an option comes from: flag > environment > configuration file > default.

A configuration file holds options under the names of their long flags: `max_rms` or `max-rms` for
`--max-rms`.
At the top level they hold for every command that has them; under the name of a command, for that one only:

    model: opencv8
    estimate:
      max_rms: 0.5

The file feeds click's `default_map`, so that a flag or an environment variable wins by click's own rules.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

DEFAULT_FILE = "camcal.yaml"
ORIGIN = {
    ParameterSource.COMMANDLINE: "flag",
    ParameterSource.ENVIRONMENT: "env",
    ParameterSource.DEFAULT_MAP: "file",
    ParameterSource.DEFAULT: "default",
    ParameterSource.PROMPT: "flag",
}
#: Options of the run, not of its result: they stand neither in a configuration file nor in a report.
NOT_SETTINGS = ("config", "help", "verbose", "quiet", "version")


class SettingOption(click.Option):
    """An option whose bad value is reported with the place it came from."""

    def process_value(self, ctx: click.Context, value: Any) -> Any:
        """Convert the value; name the environment variable or the file where it cannot be."""
        try:
            return super().process_value(ctx, value)
        except click.BadParameter as error:
            source = ctx.get_parameter_source(self.name or "")
            if source is ParameterSource.ENVIRONMENT:
                error.param_hint = str(self.envvar)
            elif source is ParameterSource.DEFAULT_MAP:
                error.param_hint = place_of(ctx, self)
            raise


def resolved_options(ctx: click.Context) -> dict[str, dict[str, Any]]:
    """Return `{name: {value, from}}` of each option; `from` is flag, env, file or default."""
    resolved = {}
    for param in ctx.command.params:
        if isinstance(param, click.Option) and param.name in ctx.params and param.name not in NOT_SETTINGS:
            source = ctx.get_parameter_source(param.name)
            origin = ORIGIN[source] if source else "default"
            resolved[param.name] = {"value": _readable(ctx.params[param.name]), "from": origin}
    return resolved


def _readable(value: Any) -> Any:
    """Write named values (a length) as the text the user would type, paths as text."""
    return str(value) if isinstance(value, Path) or hasattr(value, "unit") else value


def read_config(ctx: click.Context, param: click.Parameter, value: Path | None) -> Path | None:
    """Read `--config FILE`, else ./camcal.yaml, into the context's default_map (a callback of `--config`)."""
    path = value or (Path(DEFAULT_FILE) if Path(DEFAULT_FILE).is_file() else None)
    if path is not None:
        raise NotImplementedError(path)
    return path


def place_of(ctx: click.Context, param: click.Parameter) -> str:
    """Say where in the configuration file the option stands: `camcal.yaml:7: model`."""
    return f"{DEFAULT_FILE}: {param.name}"
