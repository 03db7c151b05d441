"""Untrusted YAML, JSON and TOML, read by parsers that execute and expand nothing, with limits.

A few lines of nested aliases stand for gigabytes, deep nesting overflows the stack of a recursive parser, and a
number of thousands of digits takes quadratic time; all are refused before anything is built.
"""

from __future__ import annotations

import json
import os
from typing import Any

import yaml

from camcal.errors import DataError

#: bytes of a document: a report of some millions of points, a reconstruction of thousands of pictures
LARGEST = 256 << 20
#: levels of nesting; the deepest file known (a reconstruction of AliceVision) has 9
DEEPEST = 60
#: aliases of one file; Kalibr's writer makes a few where two cameras share a list
MOST_ALIASES = 1000
_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_FAILURES = (ValueError, RecursionError, OverflowError, TypeError, MemoryError)

Path = str | os.PathLike


def parse_json(text: str, path: Path) -> Any:
    """The content of a JSON document; DataError if it is invalid."""
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        raise broken(path, "JSON", f"{error.msg} at line {error.lineno}") from None
    except _FAILURES as error:
        raise broken(path, "JSON", error) from None


def parse_toml(text: str, path: Path) -> Any:
    """The content of a TOML document; DataError if it is invalid."""
    try:
        import tomllib

        return tomllib.loads(text)
    except _FAILURES as error:
        raise broken(path, "TOML", error) from None


def parse_yaml(text: str, path: Path, aliases: int = MOST_ALIASES) -> Any:
    """The content of a YAML document with at most the given number of aliases; DataError if it is invalid."""
    text = as_yaml(text)
    try:
        _check_events(text, path, aliases)
        return yaml.load(text, Loader=_Loader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"line {mark.line + 1}" if mark is not None else "an unknown character"
        raise broken(path, "YAML", f"the error is at {where}") from None
    except _FAILURES as error:
        raise broken(path, "YAML", error) from None


def as_yaml(text: str) -> str:
    """Convert OpenCV's YAML to YAML: 4.x starts with `%YAML:1.0`; matrices have tags, nd-matrices since 5.0."""
    if text.startswith("%YAML"):
        text = text.partition("\n")[2]
    return text.replace("!!opencv-matrix", "").replace("!!opencv-nd-matrix", "")


def broken(path: Path, kind: str, why: object) -> DataError:
    """The error for a document that is not of the expected kind."""
    said = str(why).partition("\n")[0].rstrip(".") or type(why).__name__
    return DataError(f"'{path}' is not readable as {kind}: {said[:200]}.", "Is it damaged?")


def _check_events(text: str, path: Path, most: int) -> None:
    """Reject deep nesting, many aliases, and aliases within anchored nodes."""
    depth = aliases = 0
    anchored: list[int] = []
    for event in yaml.parse(text, _Loader):
        if isinstance(event, yaml.AliasEvent):
            aliases += 1
            if anchored or aliases > most:
                raise broken(path, "YAML", "it contains aliases such as *name")
        elif isinstance(event, yaml.CollectionStartEvent):
            depth += 1
            if event.anchor:
                anchored.append(depth)
            if depth > DEEPEST:
                raise broken(path, "YAML", f"nested more than {DEEPEST} deep")
        elif isinstance(event, yaml.CollectionEndEvent):
            if anchored and anchored[-1] == depth:
                anchored.pop()
            depth -= 1
