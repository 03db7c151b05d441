"""The configuration file: read strictly, and checked against what the commands know. Imports no numpy."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from camcal.data.yaml_strict import KeyPath, parse
from camcal.errors import UsageError
from camcal.registry import suggestion

LARGEST = 1 << 20


@dataclass(frozen=True)
class Config(Mapping[str, Any]):
    """The keys and values of a configuration file, with their lines.

    Attributes
    ----------
    path : str
    data : dict
    lines : dict
        The line of each key, by the keys that lead to it: `("estimate", "model")`.
    """

    path: str
    data: dict[str, Any]
    lines: dict[KeyPath, int]

    def __getitem__(self, key: str) -> Any:
        return self.data[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self.data)

    def __len__(self) -> int:
        return len(self.data)

    def where(self, *keys: str) -> str:
        """Say where a key stands, `camcal.yaml:7`; `max_rms` also finds the spelling `max-rms`."""
        wanted = tuple(normal(key) for key in keys)
        for found, line in self.lines.items():
            if tuple(normal(key) for key in found) == wanted:
                return f"{self.path}:{line}"
        return self.path


@dataclass(frozen=True)
class Choice:
    """A schema entry: one of some words."""

    words: tuple[str, ...]


@dataclass(frozen=True)
class ListOf:
    """A schema entry: a YAML list of `item`; a single value stands for a list of one."""

    item: Any = str


@dataclass(frozen=True)
class Text:
    """A schema entry: text that may look like a number (`square: 25`); it is returned as str."""

    what: str = "text"


@dataclass(frozen=True)
class AnyOf:
    """A schema entry: the first of some entries that accepts the value."""

    entries: tuple[Any, ...]


Schema = Mapping[str, Any]  #: key -> str, int, float, bool, Choice, ListOf, Text, AnyOf, or a nested Schema


def normal(key: str) -> str:
    """A key with underscores: `max-rms` and `max_rms` are the same."""
    return key.replace("-", "_")


def load_config(path: str | os.PathLike) -> Config:
    """Read a configuration file; an empty one is an empty configuration.

    Raises
    ------
    UsageError
        With file and line, where the file cannot be read, is not YAML, is not a mapping of names, or has a
        key twice.
    """
    name = os.fspath(path)
    text = _read(name)
    value, lines = parse(text, name)
    if value is None:
        value = {}
    if not isinstance(value, dict):
        raise UsageError(
            f"{name}:1: {_said(value)} found; `key: value` lines are needed.",
            "Write the name of an option, a colon and its value.",
        )
    return Config(name, value, lines)


def _read(name: str) -> str:
    try:
        with Path(name).open("rb") as stream:
            data = stream.read(LARGEST + 1)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise UsageError(
            f"{name}: cannot be read: {reason.lower()}.", "Check the name given to --config."
        ) from None
    if len(data) > LARGEST:
        raise UsageError(
            f"{name}: more than {LARGEST} bytes; a configuration is short.", "Is it the right file?"
        )
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        raise UsageError(f"{name}:{line}: not UTF-8 text.", "Save the file as UTF-8.") from None


def validate(config: Config, schema: Schema) -> dict[str, Any]:
    """Check a configuration and return its values under the schema's spelling of the keys.

    Whole numbers become floats where the schema says float, `ListOf` gives lists, `Text` gives str.

    Raises
    ------
    UsageError
        `camcal.yaml:7: unknown key 'modle'.` with a suggestion; `camcal.yaml:3: 'max_rms' is 'abc'; a number
        is needed.`; a key given in both spellings.
    """
    return _mapping(config, config.data, schema, ())


def _mapping(config: Config, values: Mapping[str, Any], schema: Schema, keys: KeyPath) -> dict[str, Any]:
    known = {normal(key): key for key in schema}
    checked: dict[str, Any] = {}
    for written, value in values.items():
        place = (*keys, written)
        where = f"{config.path}:{config.lines[place]}"
        key = known.get(normal(written))
        if key is None:
            raise UsageError(f"{where}: unknown key '{written}'.", _hint(written, schema, keys))
        if key in checked:
            raise UsageError(f"{where}: '{written}' is given a second time; once is needed.", "Remove one.")
        entry = schema[key]
        if isinstance(entry, Mapping):
            if not isinstance(value, Mapping):
                _wrong(where, written, value, _Rejected("a group of `key: value` lines under it"))
            checked[key] = _mapping(config, value, entry, place)
        else:
            checked[key] = _scalar_or_list(entry, value, where, written)
    return checked


class _Rejected(Exception):
    """A value that an entry does not take: what is needed instead, and perhaps a hint."""

    def __init__(self, needed: str, hint: str | None = None):
        super().__init__(needed)
        self.needed = needed
        self.hint = hint


def _scalar_or_list(entry: Any, value: Any, where: str, key: str) -> Any:
    try:
        return _accept(entry, value)
    except _Rejected as error:
        _wrong(where, key, value, error)


def _wrong(where: str, key: str, value: Any, rejected: _Rejected) -> NoReturn:
    found = f"'{key}' has no value" if value is None else f"'{key}' is {_said(value)}"
    hint = "Remove the line to use the default." if value is None else rejected.hint
    raise UsageError(f"{where}: {found}; {rejected.needed} is needed.", hint)


def _accept(entry: Any, value: Any) -> Any:
    """The value as the entry returns it; raises _Rejected where it takes no such value."""
    if isinstance(entry, AnyOf):
        return _any_of(entry, value)
    if isinstance(entry, ListOf):
        items = value if isinstance(value, list) else [value]
        return [_accept(entry.item, item) for item in items]
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if isinstance(entry, Choice):
        if value in entry.words and isinstance(value, str):
            return value
        near = suggestion(value, entry.words) if isinstance(value, str) else None
        raise _Rejected(f"one of {', '.join(entry.words)}", near)
    if isinstance(entry, Text):
        if isinstance(value, str) or number:
            return str(value)
        raise _Rejected(entry.what)
    if entry is float and number and math.isfinite(value):
        return float(value)
    if entry in (int, bool, str) and type(value) is entry:
        return value
    raise _Rejected(_NEEDED[entry])


_NEEDED = {
    float: "a number",
    int: "a whole number",
    bool: "true or false",
    str: "text",
}


def _any_of(entry: AnyOf, value: Any) -> Any:
    needed = []
    for option in entry.entries:
        try:
            return _accept(option, value)
        except _Rejected as error:
            needed.append(error.needed)
    raise _Rejected(" or ".join(needed))


def _said(value: Any) -> str:
    """A value as the message shows it."""
    if isinstance(value, list):
        return "a list"
    if isinstance(value, Mapping):
        return "a group of keys"
    text = str(value).lower() if isinstance(value, bool) else str(value)
    return f"'{text if len(text) <= 40 else text[:37] + '...'}'"


def _hint(key: str, schema: Schema, keys: KeyPath) -> str:
    """The nearest known key; else the groups that know it; else all known keys."""
    owners = [
        name
        for name, entry in schema.items()
        if isinstance(entry, Mapping) and normal(key) in map(normal, entry)
    ]
    if owners:
        return f"It belongs under {' or '.join(owners)}."
    near = suggestion(normal(key), schema)
    inside = f" under {keys[-1]}" if keys else ""
    return near or f"Known{inside}: {', '.join(sorted(schema))}."
