"""click's options, made from `camcal.settings`, and the origin of each value.

A value comes from the flag, else from the environment (`CAMCAL_MAX_RMS` for `--max-rms`), else from the
configuration file, else from the default. The file feeds click's `default_map`, so that click's own rules make a
flag or an environment variable win.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from camcal.errors import UsageError
from camcal.settings.commands import OPTIONS
from camcal.settings.kinds import FilePath, Kind, Several
from camcal.settings.option import Option, readable

ORIGIN = {
    ParameterSource.COMMANDLINE: "flag",
    ParameterSource.ENVIRONMENT: "env",
    ParameterSource.DEFAULT_MAP: "file",
    ParameterSource.DEFAULT: "default",
    ParameterSource.PROMPT: "flag",
}
#: options that do not affect the result: they are not part of a report
NOT_IN_REPORTS = ("config", "help", "verbose", "quiet", "version")
CONFIG = "camcal.config"  #: the key of the path that was read, in `ctx.meta`


class HintedError(click.BadParameter):
    """A bad value, with a hint."""

    def __init__(self, error: UsageError, **kwargs: Any):
        super().__init__(error.message, **kwargs)
        self.hint = error.hint


class KindType(click.ParamType):
    """click's type of a kind of value."""

    def __init__(self, kind: Kind):
        self.name, self.kind = kind.metavar, kind

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the value in the form that the program uses."""
        try:
            return self.kind.convert(value)
        except UsageError as error:
            raise HintedError(error, param=param, ctx=ctx) from error

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[Any]:
        """Offer files, or the names of a table."""
        if isinstance(self.kind, FilePath):
            return click.Path().shell_complete(ctx, param, incomplete)
        from click.shell_completion import CompletionItem

        return [CompletionItem(name) for name in self.kind.words() if name.startswith(incomplete)]


class SettingOption(click.Option):
    """An option of a command, made from its definition."""

    def __init__(self, setting: Option, **more: Any):
        self.setting = setting
        names = [setting.long + (f"/{setting.off}" if setting.off else ""), *filter(None, [setting.short])]
        shown = isinstance(setting.default, (str, int, float)) and setting.default is not False
        super().__init__(
            [*names, setting.name],
            help=setting.help,
            show_default=shown and setting.show_default,
            required=setting.required,
            multiple=setting.repeated,
            is_flag=setting.is_switch,
            envvar=setting.environment,
            type=None if setting.is_switch else KindType(_item_of(setting)),
            metavar=None if setting.is_switch else setting.value_name,
            **more | _default(setting),
        )

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[Any]:
        """Offer the cameras that the line names if one is expected; otherwise the completions of the kind of
        value.
        """
        from click.shell_completion import CompletionItem

        from camcal.cli.completion import OF_CAMERAS, camera_names

        if self.setting.name not in OF_CAMERAS or isinstance(_item_of(self.setting), FilePath):
            return super().shell_complete(ctx, incomplete)
        before, comma, last = incomplete.rpartition(",")
        return [CompletionItem(before + comma + n) for n in camera_names() if n.startswith(last)]

    def add_to_parser(self, parser: Any, ctx: click.Context) -> None:
        """Allow a switch that takes words to be followed by one: `--crosscheck full`."""
        super().add_to_parser(parser, ctx)
        words = self.setting.kind.words() if self.setting.is_switch else []
        if not words:
            return
        # click has no flags with an optional word that leave other arguments alone
        own = parser._long_opt[self.setting.long]
        process = own.process

        def with_word(value: Any, state: Any) -> None:
            process(value, state)
            if state.rargs and state.rargs[0] in words:
                state.opts[own.dest] = state.rargs.pop(0)

        own.process = with_word
        match = parser._match_long_opt

        def split(name: str, value: str | None, state: Any) -> None:
            if name == self.setting.long and value in words:  # --crosscheck=full
                state.rargs.insert(0, value)
                value = None
            match(name, value, state)

        parser._match_long_opt = split

    def type_cast_value(self, ctx: click.Context, value: Any) -> Any:
        """Pass a word of a switch through unchanged."""
        if self.setting.is_switch and value in self.setting.kind.words():
            return value
        return super().type_cast_value(ctx, value)

    def process_value(self, ctx: click.Context, value: Any) -> Any:
        """Convert the value; an error names the environment variable if the value came from one."""
        try:
            found = super().process_value(ctx, value)
            return KindType(self.setting.kind).convert(list(found), self, ctx) if self.multiple else found
        except click.BadParameter as error:
            if ctx.get_parameter_source(self.name or "") is ParameterSource.ENVIRONMENT:
                error.param_hint = str(self.envvar)
            raise


def _default(setting: Option) -> dict[str, Any]:
    """Return click's `default`; nothing for a required option, since click 8.3 would treat it as a given value."""
    if setting.required:
        return {}
    return {"default": tuple(setting.default or ()) if setting.repeated else setting.default}


def _item_of(setting: Option) -> Kind:
    """Return the kind of one value of an option that may be repeated."""
    return setting.kind.item if isinstance(setting.kind, Several) else setting.kind


def options(command: str) -> Callable[[Any], Any]:
    """Return a decorator that gives a command its options."""
    early = {
        "config": {"is_eager": True, "expose_value": False, "callback": _read_config(command)},
        # numpy reads the number of its threads when it is loaded, which no command has done yet
        "reproducible": {"is_eager": True, "callback": _use_one_thread},
    }
    made = [SettingOption(o, **early.get(o.name, {})) for o in OPTIONS[command]]

    def apply(function: Any) -> Any:
        function.__dict__.setdefault("__click_params__", []).extend(reversed(made))
        return function

    return apply


def _use_one_thread(ctx: click.Context, param: click.Parameter, value: bool) -> bool:
    """With --reproducible, compute sums in one order, for any number of processors."""
    if value:
        from camcal.system.processes import use_one_thread

        use_one_thread()
    return value


def _read_config(command: str) -> Callable[[click.Context, click.Parameter, Path | None], None]:
    """Return the callback of `--config`, which feeds that file or ./camcal.yaml to the `default_map`."""

    def read(ctx: click.Context, param: click.Parameter, value: Path | None) -> None:
        from camcal.settings.config import DEFAULT_FILE, load_config, values_for

        path = value or (Path(DEFAULT_FILE) if Path(DEFAULT_FILE).is_file() else None)
        if path is None or ctx.resilient_parsing:
            return
        held = values_for(command, load_config(path, named=value is not None))
        repeated = {o.name for o in OPTIONS[command] if o.repeated and not isinstance(o.kind, Several)}
        ctx.default_map = {name: [v] if name in repeated else v for name, v in held.items()}
        ctx.meta[CONFIG] = str(path)

    return read


def resolved_options(ctx: click.Context) -> dict[str, dict[str, Any]]:
    """Return `{name: {value, from}}` of each option; `from` is flag, env, file or default.

    Where a configuration file was read, `config` says which.
    """
    resolved = {}
    for param in ctx.command.params:
        if isinstance(param, click.Option) and param.name in ctx.params and param.name not in NOT_IN_REPORTS:
            origin = origin_of(ctx, param.name)
            resolved[param.name] = {"value": readable(ctx.params[param.name]), "from": origin}
    if CONFIG in ctx.meta:
        resolved["config"] = {"value": ctx.meta[CONFIG], "from": origin_of(ctx, "config")}
    return resolved


def settle(ctx: click.Context, options: dict[str, Any], **usual: Any) -> None:
    """Give options without a value the values used in the run, in `options` and in the report's list."""
    for name, value in usual.items():
        if options[name] is None:
            options[name] = ctx.params[name] = value


def origin_of(ctx: click.Context, name: str) -> str:
    """Return the origin of an option's value: flag, env, file or default."""
    source = ctx.get_parameter_source(name)
    return ORIGIN[source] if source else "default"
