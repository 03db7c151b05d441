"""The configuration file: options under the names of their flags, read strictly.

At the top level they hold for every command that has them; under the name of a command, for that one only:

    model: opencv8
    estimate:
      max_rms: 0.5
"""

from __future__ import annotations

import difflib
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from camcal.errors import DataError, UsageError
from camcal.records import dataclass
from camcal.registry import suggestion
from camcal.settings.commands import OPTIONS, options_of
from camcal.settings.option import Option
from camcal.settings.yaml_strict import KeyPath, parse
from camcal.system.reading import read_file
from camcal.system.text import quoted

DEFAULT_FILE = "camcal.yaml"
LARGEST = 1 << 20  #: bytes; a configuration of every option is below 10 kB
NEAREST = 3  #: known keys in the hint to an unknown one, where none is close
#: options of the run that a file cannot hold
NOT_IN_FILES = ("config",)


@dataclass(frozen=True)
class Config:
    """The keys and values of a configuration file, with their lines.

    Attributes
    ----------
    path : str
    data : dict
    lines : dict
        The line of each key, by the keys that lead to it: `("estimate", "model")`.
    named : bool
        Whether the user named the file. One that only lies in the folder, perhaps with somebody's data, must not
        say what is written or overwritten.
    """

    path: str
    data: dict[str, Any]
    lines: dict[KeyPath, int]
    named: bool = True

    def where(self, *keys: str) -> str:
        """Return the place of a key, `camcal.yaml:7`."""
        return f"{self.path}:{self.lines[keys]}"


def normal(key: str) -> str:
    """Return a key with underscores: `max-rms` and `max_rms` are the same."""
    return key.replace("-", "_")


def load_config(path: str | os.PathLike, named: bool = True) -> Config:
    """Read a configuration file; an empty one is an empty configuration.

    Raises
    ------
    UsageError
        With file and line, where the file cannot be read, is not YAML, is not a mapping of names, or has a
        key twice.
    """
    name = os.fspath(path)
    value, lines = parse(_read(name), name)
    if value is None:
        value = {}
    if not isinstance(value, dict):
        found = "a list" if isinstance(value, list) else quoted(value)
        raise UsageError(
            f"{name}:1: {found} found; `key: value` lines are needed.",
            "Write the name of an option, a colon and its value.",
        )
    return Config(name, value, lines, named)


def _read(name: str) -> str:
    try:
        data = read_file(name, LARGEST, "a configuration", "Check the name given to --config.")
    except DataError as error:
        raise UsageError(f"{name}: cannot be read: {error.message}", error.hint) from None
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        raise UsageError(f"{name}:{line}: not UTF-8 text.", "Save the file as UTF-8.") from None


def values_for(command: str, config: Config) -> dict[str, Any]:
    """Check the whole file and return the values of the options of one command, converted.

    Parameters
    ----------
    command : str
        As in `camcal.settings.commands.OPTIONS`: "estimate", "simulate points".

    Raises
    ------
    UsageError
        `camcal.yaml:7: unknown key 'modle'.` with a suggestion; `camcal.yaml:3: max_rms: 'abc' is not a number
        above 0.`; a key given in both spellings.
    """
    own = _in_files(command)
    groups = {name.partition(" ")[0] for name in OPTIONS}
    everywhere = {name: found for other in OPTIONS for name, found in _in_files(other).items()} | own
    top: dict[str, Any] = {}
    nested: dict[str, Any] = {}
    for key, value in config.data.items():
        if key in groups and (isinstance(value, Mapping) or normal(key) not in everywhere):
            inside = _in_files(key)
            is_own = key == command.partition(" ")[0]
            found = _group(config, key, inside | own if is_own else inside)
            nested = {n: v for n, v in found.items() if n in own} if is_own else nested
        else:
            _one(config, (key,), value, everywhere, own, top)
    return {name: held for name, held in top.items() if name in own} | nested


def _in_files(command: str) -> dict[str, Option]:
    return {name: option for name, option in options_of(command).items() if name not in NOT_IN_FILES}


def _group(config: Config, name: str, known: Mapping[str, Option]) -> dict[str, Any]:
    values = config.data[name]
    if not isinstance(values, Mapping):
        raise UsageError(
            f"{config.where(name)}: {name}: {quoted(values)} found; options of the command are needed.",
            "Write `key: value` lines below it, indented.",
        )
    found: dict[str, Any] = {}
    for key, value in values.items():
        _one(config, (name, key), value, known, known, found)
    return found


def _one(
    config: Config,
    keys: KeyPath,
    value: Any,
    known: Mapping[str, Option],
    own: Mapping[str, Option],
    found: dict[str, Any],
) -> None:
    """Check one key and put its value into `found`."""
    where, written = config.where(*keys), keys[-1]
    name = normal(written)
    if name not in known:
        raise UsageError(f"{where}: unknown key '{written}'.", _hint(name, known, keys[:-1]))
    if name in found:
        raise UsageError(f"{where}: '{written}' is given a second time; once is needed.", "Remove one.")
    if value is None:
        raise UsageError(f"{where}: '{written}' has no value.", "Remove the line to use the default.")
    if not config.named and known[name].writes:
        raise UsageError(
            f"{where}: '{written}' names an output, which a file not given by --config cannot set.",
            f"Pass the file explicitly: --config {config.path}",
        )
    if not config.named and known[name].network:
        raise UsageError(
            f"{where}: '{written}' is an address, which a file not given by --config cannot set.",
            f"Pass the file explicitly: --config {config.path}",
        )
    if not config.named and known[name].reads and not _inside(value, Path(config.path).parent):
        raise UsageError(
            f"{where}: '{written}' leads out of the folder, which a file not given by --config cannot do.",
            f"Pass the file explicitly: --config {config.path}",
        )
    # options of one name may differ between commands: any that takes the value will do for another command
    candidates = [own[name]] if name in own else _all_of(name)
    for left, option in enumerate(candidates[::-1]):
        try:
            found[name] = option.convert(value)
            break
        except UsageError as error:
            if left == len(candidates) - 1:
                raise UsageError(f"{where}: {written}: {error.message}", error.hint) from None


def _inside(value: Any, folder: Path) -> bool:
    """Return whether every file that a value names lies in a folder after symbolic links are resolved."""
    names = value if isinstance(value, list) else [value]
    root = os.path.realpath(folder)
    return all(isinstance(n, str) and Path(os.path.realpath(folder / n)).is_relative_to(root) for n in names)


def _all_of(name: str) -> list[Option]:
    found = [_in_files(command).get(name) for command in OPTIONS]
    return [option for option in found if option is not None]


def _hint(name: str, known: Mapping[str, Option], inside: KeyPath) -> str:
    """Return a hint with the known key that is meant, or else with the keys nearest in spelling and where all are."""
    meant = suggestion(name, known)
    if meant is not None:
        return meant
    near = ", ".join(difflib.get_close_matches(name, known, n=NEAREST, cutoff=0.0))
    if inside:
        return f"The nearest under {inside[-1]}: {near}. All: camcal {inside[-1]} --help"
    return f"The nearest: {near}. A key is an option of a command, with _ for -; all: camcal COMMAND --help"
