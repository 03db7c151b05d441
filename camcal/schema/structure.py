"""Read a plain document as the sections of the schema; errors name the path to the bad value."""

from __future__ import annotations

import types
from collections.abc import Mapping
from functools import cache
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin

import msgspec
from msgspec import Meta, UnsetType

from camcal.errors import DataError
from camcal.schema.kinds import Section
from camcal.system.text import quoted

T = TypeVar("T")

_CONTAINERS = (dict, list, tuple, Mapping)
#: what stands for a type in a message
_NAMES = {bool: "true or false", int: "a whole number", float: "a number", str: "text"}


def structure(kind: type[T], value: Any, source: str, path: str = "") -> T:
    """Return a plain value as a section of the schema.

    Parameters
    ----------
    kind : type
        A `Section`, or any type that msgspec reads.
    value : object
        Of plain Python types, as YAML and JSON give them.
    source : str
        The file's name, for messages.
    path : str
        The path of `value` in the document, for messages.

    Raises
    ------
    DataError
        `'r.yaml' is damaged: cameras.left.parameters.fx.value is 'abc'; a finite number is needed.`
    """
    try:
        return msgspec.convert(value, kind)
    except msgspec.ValidationError as error:
        message = _located(kind, value, path) or str(error)
        raise DataError(f"'{source}' is damaged: {message}.", "Create the report again.") from None


def _fits(kind: Any, value: Any) -> bool:
    try:
        msgspec.convert(value, kind)
    except msgspec.ValidationError:
        return False
    return True


def _located(kind: Any, value: Any, path: str) -> str | None:
    """Describe which part of a value does not fit, by descending to it; None if all parts fit."""
    kind, metas = _bare(kind, value)
    for name, inner, part in _parts(kind, value):
        if part is msgspec.NODEFAULT:
            return f"'{_join(path, name)}' is missing"
        if not _fits(inner, part):
            return _located(inner, part, _join(path, name))
    return f"{path or 'it'} is {_shown(value)}; {_needed(kind, metas)} is needed"


def _join(path: str, name: str | int) -> str:
    if isinstance(name, int):
        return f"{path}[{name}]"
    return f"{path}.{name}" if path else name


def _bare(kind: Any, value: Any) -> tuple[Any, tuple[Meta, ...]]:
    """Remove annotations from a type, and select the relevant member of a union: not null, not missing."""
    metas: tuple[Meta, ...] = ()
    while True:
        if get_origin(kind) is Annotated:
            kind, *more = get_args(kind)
            metas += tuple(m for m in more if isinstance(m, Meta))
        elif get_origin(kind) in (Union, types.UnionType):
            members = [k for k in get_args(kind) if k not in (types.NoneType, UnsetType)]
            kind = members[0] if members else Any
        else:
            return kind, metas


def _parts(kind: Any, value: Any) -> list[tuple[str | int, Any, Any]]:
    """The parts of a value as (name, type, part); a required part that is missing is `NODEFAULT`."""
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct) and isinstance(value, Mapping):
        hints = hints_of(kind)
        required = _required(kind)
        return [
            (name, hint, value.get(name, msgspec.NODEFAULT))
            for name, hint in hints.items()
            if name in required or name in value
        ]
    arguments = get_args(kind)
    if get_origin(kind) is dict and isinstance(value, Mapping):
        return [(name, arguments[1], part) for name, part in value.items() if isinstance(name, str)]
    if get_origin(kind) is list and isinstance(value, (list, tuple)):
        return [(i, arguments[0], part) for i, part in enumerate(value)]
    if get_origin(kind) is tuple and isinstance(value, (list, tuple)) and len(value) == len(arguments):
        return [(i, inner, part) for i, (inner, part) in enumerate(zip(arguments, value, strict=True))]
    return []


@cache
def hints_of(kind: type[msgspec.Struct]) -> dict[str, Any]:
    """The types of a section's keys, annotations included, in their order."""
    return {field.encode_name: field.type for field in _fields(kind)}


@cache
def _required(kind: type[msgspec.Struct]) -> frozenset[str]:
    """The keys that a section must have."""
    return frozenset(field.encode_name for field in _fields(kind) if field.required)


@cache
def _fields(kind: type[msgspec.Struct]) -> tuple[msgspec.structs.FieldInfo, ...]:
    """msgspec's description of a section's keys, cached because evaluating their types takes a third of a
    millisecond.
    """
    return msgspec.structs.fields(kind)


def unknown_key(kind: Any, value: Any, path: str = "") -> str | None:
    """Return the path to the first key of a plain document that the schema does not have, or None."""
    if not isinstance(value, _CONTAINERS):
        return None
    kind, _ = _bare(kind, value)
    section = isinstance(kind, type) and issubclass(kind, Section)
    if section and isinstance(value, Mapping) and not kind.open:
        known = kind.__struct_encode_fields__
        for name in value:
            if name not in known:
                return _join(path, name)
    inside = value.values() if isinstance(value, Mapping) else value
    if not any(isinstance(part, _CONTAINERS) for part in inside):
        return None  # numbers and words, the most of a report: their types need not be evaluated
    for name, inner, part in _parts(kind, value):
        if isinstance(part, _CONTAINERS):
            found = unknown_key(inner, part, _join(path, name))
            if found is not None:
                return found
    return None


def _needed(kind: Any, metas: tuple[Meta, ...]) -> str:
    """Describe what a type accepts."""
    if get_origin(kind) is Literal:
        return " or ".join(f"'{word}'" for word in get_args(kind))
    if get_origin(kind) is tuple:
        return f"a list of {len(get_args(kind))}"
    if get_origin(kind) is list:
        return "a list"
    if kind not in _NAMES:
        return "a group of keys" + (" with entries" if any(m.min_length for m in metas) else "")
    if any(m.min_length for m in metas):
        return f"{_NAMES[kind]} that is not empty"
    low = max((m.ge for m in metas if m.ge is not None), default=None)
    if kind is float and low is not None and low < -1:
        return "a finite number"
    return _NAMES[kind] + ("" if low is None else f" from {low:g} up")


def _shown(value: Any) -> str:
    if value is None:
        return "null"
    if isinstance(value, (Mapping, list, tuple)):
        return "a group of keys" if isinstance(value, Mapping) else f"a list of {len(value)}"
    return quoted(value)
