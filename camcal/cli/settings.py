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

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from camcal.cli import COMMANDS
from camcal.cli.params import BoardType, SizeType
from camcal.registry import load

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
CONFIG = "camcal.config"  #: the key of the file that was read, in `ctx.meta`


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
    """Return `{name: {value, from}}` of each option; `from` is flag, env, file or default.

    Where a configuration file was read, `config` says which.
    """
    resolved = {}
    for param in ctx.command.params:
        if isinstance(param, click.Option) and param.name in ctx.params and param.name not in NOT_SETTINGS:
            source = ctx.get_parameter_source(param.name)
            origin = ORIGIN[source] if source else "default"
            resolved[param.name] = {"value": _readable(ctx.params[param.name]), "from": origin}
    if CONFIG in ctx.meta:
        source = ctx.get_parameter_source("config")
        resolved["config"] = {"value": ctx.meta[CONFIG].path, "from": ORIGIN[source] if source else "default"}
    return resolved


def _readable(value: Any) -> Any:
    """Write named values (a length) as the text the user would type, paths as text."""
    return str(value) if isinstance(value, Path) or hasattr(value, "unit") else value


def read_config(ctx: click.Context, param: click.Parameter, value: Path | None) -> None:
    """Feed `--config FILE`, else ./camcal.yaml, to the context's default_map (a callback of `--config`).

    Raises
    ------
    UsageError
        With file and line: not a configuration, an unknown key, a value of the wrong type.
    """
    path = value or (Path(DEFAULT_FILE) if Path(DEFAULT_FILE).is_file() else None)
    if path is None or ctx.resilient_parsing:
        return
    from camcal.data.config import load_config, validate

    config = load_config(path)
    own = settings_of(ctx.command)
    values = validate(config, _schema(config, ctx.command))
    group = values.get(ctx.command.name or "")
    shared = {name: held for name, held in values.items() if name in own and not isinstance(held, dict)}
    ctx.default_map = {**shared, **(group if isinstance(group, dict) else {})}
    ctx.meta[CONFIG] = config


def place_of(ctx: click.Context, option: click.Option) -> str:
    """Say where in the configuration file an option stands: `camcal.yaml:7: square`."""
    config, command, name = ctx.meta[CONFIG], ctx.command.name or "", option.name or ""
    nested = config.where(command, name)
    return f"{nested if nested != config.path else config.where(name)}: {name}"


def settings_of(command: click.Command) -> dict[str, click.Option]:
    """Return the options of a command that a configuration file may hold, by name."""
    options = [p for p in command.params if isinstance(p, click.Option)]
    return {option.name: option for option in options if option.name and option.name not in NOT_SETTINGS}


def _schema(config: Mapping[str, Any], running: click.Command) -> dict[str, Any]:
    """Return what a file may hold: the options of every command, and a group of keys for each command.

    Where an option and a command have one name, the value in the file says which is meant: a group of keys
    is the command's.
    """
    known = {name: load(path) for name, (path, _) in COMMANDS.items()}
    options: dict[str, Any] = {}
    groups: dict[str, Any] = {}
    for name, command in {**known, str(running.name): running}.items():
        groups[name] = {key: _entry(option) for key, option in settings_of(command).items()}
        options |= groups[name]
    groups = {name: keys for name, keys in groups.items() if keys}
    clash = {name for name in groups if name in options and not isinstance(config.get(name), Mapping)}
    return options | {name: keys for name, keys in groups.items() if name not in clash}


def _entry(option: click.Option) -> Any:
    """Return the schema entry of an option: what its value looks like in YAML."""
    from camcal.data.config import AnyOf, Choice, ListOf, Text

    kind = option.type
    if option.is_flag:
        return bool
    if option.multiple:
        return ListOf(Text())
    if isinstance(kind, click.Choice):
        return Choice(tuple(kind.choices))
    if isinstance(kind, type(click.INT)):
        return int
    if isinstance(kind, type(click.FLOAT)):
        return float
    if isinstance(kind, (BoardType, SizeType)):
        return AnyOf((Text(f"text such as {kind.name}"), ListOf(int)))
    return Text()
