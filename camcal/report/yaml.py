"""YAML and JSON of plain documents: exact numbers, short lists on one line, fast.

What PyYAML does by itself and a report must not: `safe_dump` refuses np.float64 (documents are plain already,
see `plain.py`), repeated objects become anchors (turned off), a matrix is spread over a line a number
(flow style for what fits on a line). `1e-05` is written as `1.0e-05`, which YAML 1.1 reads as a number.
Every float64 reads back as the same float64.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import re
from functools import lru_cache
from pathlib import Path
from typing import Any

import yaml

from camcal.errors import DataError
from camcal.system.documents import LARGEST, parse_yaml
from camcal.system.reading import read_text
from camcal.system.text import escaped, has_unsafe
from camcal.system.writing import atomic_write

_Dumper: Any = getattr(yaml, "CSafeDumper", yaml.SafeDumper)

_RESOLVER: Any = yaml.resolver.Resolver()

#: a mapping or list up to this length, as text, is written on one line
LINE = 96
#: the key of a report under which most lines are those of the report before: half of the time that writing takes
OPTIONS = "options"
#: lines that are kept, at most: a report has some fifty, of which the jobs of a batch share all but one
MOST_OPTIONS = 1000
_option_lines: dict[str, str] = {}
#: text that YAML 1.2 reads as a number though PyYAML does not, such as the id 08
_NUMBER = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|0[ox][0-9a-fA-F]+")


class ReportDumper(_Dumper):
    """Keeps the order of keys; no anchors, short collections in flow style, long text as a block."""

    def ignore_aliases(self, data: Any) -> bool:
        """No anchors: a repeated list is written twice."""
        return True

    def resolve(self, kind: Any, value: Any, implicit: Any) -> Any:
        """The tag that a reader gives to a plain scalar; cached for the keys and words of all reports."""
        scalar = kind is yaml.ScalarNode
        return _resolved(value, implicit) if scalar else super().resolve(kind, value, implicit)


@lru_cache(maxsize=1000)  # a report has some 200 of them, and as many numbers of its own
def _resolved(value: str, implicit: tuple[bool, bool]) -> Any:
    return _RESOLVER.resolve(yaml.ScalarNode, value, implicit)


def _short(value: Any, room: int) -> int:
    """The space that is left on a line after `value`; negative if it does not fit."""
    if room < 0:
        return room
    if isinstance(value, dict):
        for key, item in value.items():
            room = _short(item, room - len(key) - 4)
        return room
    if isinstance(value, list):
        for item in value:
            room = _short(item, room - 2)
        return room
    return room - (len(value) + 2 if isinstance(value, str) else len(repr(value)))


def _collection(dumper: Any, value: Any) -> Any:
    kind = "map" if isinstance(value, dict) else "seq"
    # rows of numbers stay together even if they are long
    numbers = kind == "seq" and all(type(v) in (int, float) for v in value)
    flow = not value or numbers or _short(value, LINE) >= 0
    if kind == "map":
        return dumper.represent_mapping("tag:yaml.org,2002:map", value.items(), flow_style=flow)
    return dumper.represent_sequence("tag:yaml.org,2002:seq", value, flow_style=flow)


def _text(dumper: Any, value: str) -> Any:
    style = '"' if has_unsafe(value) else "|" if "\n" in value else "'" if _NUMBER.fullmatch(value) else None
    return dumper.represent_scalar("tag:yaml.org,2002:str", value, style=style)


class _Spread(dict):
    """A mapping with a line for each entry, however short it is."""


def _spread(dumper: Any, value: _Spread) -> Any:
    return dumper.represent_mapping("tag:yaml.org,2002:map", value.items(), flow_style=False)


ReportDumper.add_representer(_Spread, _spread)
ReportDumper.add_representer(dict, _collection)
ReportDumper.add_representer(list, _collection)
ReportDumper.add_representer(str, _text)


def dump_yaml(document: Any) -> str:
    """The YAML text of a plain document (see `plain.py`), in the order of its keys."""
    options = document.get(OPTIONS) if isinstance(document, dict) else None
    if not isinstance(options, dict) or _short(options, LINE) >= 0:
        return _dumped(document)
    at = list(document).index(OPTIONS)
    before, after = dict(list(document.items())[:at]), dict(list(document.items())[at + 1 :])
    lines = [_option(name, entry) for name, entry in options.items()]
    parts = [_dumped(_Spread(part)) if part else "" for part in (before, after)]
    return f"{parts[0]}{OPTIONS}:\n{''.join(lines)}{parts[1]}"


def _dumped(value: Any) -> str:
    text = yaml.dump(value, Dumper=ReportDumper, sort_keys=False, allow_unicode=True, width=110)
    return escaped(text)  # such characters occur only in quoted text, see `_text`


def _option(name: str, entry: Any) -> str:
    """The lines of an option in a report; cached for all reports that have the same."""
    key = f"{name} {entry!r}"
    if key not in _option_lines:
        if len(_option_lines) >= MOST_OPTIONS:
            _option_lines.clear()
        _option_lines[key] = _dumped(_Spread({OPTIONS: _Spread({name: entry})})).partition("\n")[2]
    return _option_lines[key]


def dump_json(document: Any) -> str:
    """The JSON text of a plain document.

    JSON has neither infinity nor NaN: infinity is written as the number 1e999, which readers with IEEE
    doubles take as infinity again, and NaN as null.
    """
    marker = "\ue000inf"  # a private-use character, which occurs in no text of a report
    text = json.dumps(_finite(document, marker), ensure_ascii=False, indent=1, allow_nan=False)
    return escaped(text.replace(f'"-{marker}"', "-1e999").replace(f'"{marker}"', "1e999")) + "\n"


def _finite(value: Any, marker: str) -> Any:
    if isinstance(value, dict):
        return {k: _finite(v, marker) for k, v in value.items()}
    if isinstance(value, list):
        return [_finite(v, marker) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else marker if value > 0 else "-" + marker
    return value


def save(document: dict[str, Any], path: str | os.PathLike, force: bool = False) -> None:
    """Write a document atomically as YAML, or as JSON if the file name ends in `.json`.

    Raises
    ------
    UsageError
        As `camcal.data.writing.atomic_write`.
    """
    as_json = Path(path).suffix.lower() == ".json"
    atomic_write(path, dump_json(document) if as_json else dump_yaml(document), force)


def read_document(path: str | os.PathLike) -> dict[str, Any]:
    """Read a YAML or JSON file that holds a mapping.

    Raises
    ------
    DataError
        If the file is missing, unreadable, too large, not YAML, nested too deep, or no mapping, or has
        aliases (`*name`): a few lines of them can stand for more than fits in memory.
    """
    text = read_text(path, LARGEST, "a camcal report", "A camcal report is a YAML file.")
    found = None
    if text.lstrip().startswith("{"):
        # JSON first: YAML 1.1 would read its 1e999 as text; errors are then those of the YAML parser
        with contextlib.suppress(ValueError, RecursionError):
            found = json.loads(text)
    if found is None:
        found = parse_yaml(text, path, aliases=0)
    if not isinstance(found, dict):
        raise DataError(f"'{path}' is not a camera file: it contains no mapping.", "Give a camcal report.")
    return found
