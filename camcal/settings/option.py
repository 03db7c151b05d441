"""Options, and dataclasses whose fields are options."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import MISSING, field, fields, replace
from functools import cache
from pathlib import PurePath
from typing import Any, Self

from camcal.errors import UsageError
from camcal.records import dataclass
from camcal.registry import suggestion
from camcal.settings.kinds import FilePath, Kind, OutputPath, Several, Switch

_META = "camcal.option"


@dataclass(frozen=True)
class Option:
    """One option: everything that the command line, a configuration file or the Python API needs to know about it.

    Attributes
    ----------
    name : str
        The keyword in Python, the key in camcal.yaml and in the report's `options`.
    kind : Kind
        How a value is read and checked.
    help : str
    default : object
        Of the command line; None where there is none.
    short : str
        A one-letter flag such as `-m`.
    flag : str
        The long flag; `--` and the name by default.
    off : str
        The flag that turns a switch off; a switch with one may be None, neither on nor off.
    metavar : str
        How the value is named in the help; that of its kind by default.
    required : bool
        Whether a command needs it.
    repeated : bool
        Whether the flag may be given several times; the kind then takes a list.
    show_default : bool
        Whether the help shows the default.
    on_command_line : bool
        False for what only Python offers.
    in_checkpoints : bool
        Whether `camcal track` goes on from a checkpoint only where the value is the same.
    """

    name: str
    kind: Kind
    help: str
    default: Any = None
    short: str = ""
    flag: str = ""
    off: str = ""
    metavar: str = ""
    required: bool = False
    repeated: bool = False
    show_default: bool = True
    on_command_line: bool = True
    in_checkpoints: bool = False

    @property
    def long(self) -> str:
        """Return the long flag."""
        return self.flag or "--" + self.name.replace("_", "-")

    @property
    def environment(self) -> str:
        """Return the name of the environment variable."""
        return "CAMCAL_" + self.long.strip("-").replace("-", "_").upper()

    @property
    def value_name(self) -> str:
        """Return the placeholder of the value in the help text."""
        return self.metavar or self.kind.metavar

    @property
    def is_switch(self) -> bool:
        """Return whether the option is a switch without a value."""
        return isinstance(self.kind, Switch)

    @property
    def writes(self) -> bool:
        """Return whether the option names an output or allows one to be overwritten."""
        kind = self.kind.item if isinstance(self.kind, Several) else self.kind
        return isinstance(kind, OutputPath) or self.name in ("output", "force")

    @property
    def reads(self) -> bool:
        """Return whether the option names a file to read."""
        kind = self.kind.item if isinstance(self.kind, Several) else self.kind
        return isinstance(kind, FilePath) and not self.writes

    @property
    def network(self) -> bool:
        """Return whether the option is the address of another machine."""
        return self.name == "scheduler"

    def convert(self, value: Any) -> Any:
        """Return the value in the form that the program uses; None stays None where it is the default.

        Raises
        ------
        UsageError
            If the value does not fit; the message does not name the option.
        """
        return None if value is None and self.default is None else self.kind.convert(value)


def setting(kind: Kind, help: str, default: Any = None, *, in_python: Any = MISSING, **more: Any) -> Any:
    """Return a dataclass field that is an option; `more` are further attributes of `Option`.

    Parameters
    ----------
    default : object
        On the command line.
    in_python : object, optional
        The default of the field itself, where calls from Python have another.
    """
    held = default if in_python is MISSING else in_python
    option = Option("", kind, help, default, **more)
    if isinstance(held, dict):
        return field(default_factory=dict, metadata={_META: option})
    return field(default=held, metadata={_META: option})


@dataclass(frozen=True)
class Settings:
    """Base of dataclasses whose fields are options: values are converted and checked on construction.

    Raises
    ------
    UsageError
        For a value that does not fit.
    """

    def __post_init__(self) -> None:
        for name, option in self.options().items():
            given = getattr(self, name)
            try:
                value = option.convert(given)
            except UsageError as error:
                raise UsageError(f"{name}: {error.message}", error.hint) from None
            object.__setattr__(self, name, value)

    @classmethod
    @cache
    def options(cls) -> Mapping[str, Option]:
        """Return the options by name, in the order of the fields."""
        found = {f.name: f.metadata.get(_META) for f in fields(cls)}
        return {name: replace(option, name=name) for name, option in found.items() if option is not None}

    @classmethod
    def command_line(cls, *without: str) -> tuple[Option, ...]:
        """Return the options that commands have, except those named."""
        return tuple(o for o in cls.options().values() if o.on_command_line and o.name not in without)

    @classmethod
    def resolve(cls, **keywords: Any) -> Self:
        """Make the settings from the keywords of a call; the others take their defaults.

        Raises
        ------
        UsageError
            For an unknown keyword, with the closest known one, and for a value that does not fit.
        """
        for name in keywords:
            if name not in cls.options():
                hint = suggestion(name, cls.options()) or f"Known: {', '.join(cls.options())}."
                raise UsageError(f"unknown option '{name}'.", hint)
        return cls(**keywords)

    def described(self, given: Collection[str] = ()) -> dict[str, dict[str, Any]]:
        """Return `{name: {value, from}}` for a report; `from` is `keyword` for those in `given`, else `default`."""
        return {
            name: {"value": readable(getattr(self, name)), "from": "keyword" if name in given else "default"}
            for name in self.options()
        }

    def checkpoint(self) -> dict[str, Any]:
        """Return the values that must match for a run to continue from a checkpoint."""
        return {name: getattr(self, name) for name, o in self.options().items() if o.in_checkpoints}


def readable(value: Any) -> Any:
    """Return a value as the report's `options` show it: lengths and paths as typed, a camera by its lens."""
    if hasattr(value, "lens"):
        return value.lens.name
    return str(value) if isinstance(value, PurePath) or hasattr(value, "unit") else value
