"""YAML 1.2 with the line of each key, for files that people write by hand.

PyYAML follows YAML 1.1, where `no` is false, `1e-5` is text, `12:30` is 750, and the last of two equal keys
wins silently. Here `no`, `yes`, `on` and `off` are text, `1e-5` is a number, and equal keys are an error.
Anchors, aliases and tags are refused: a configuration needs none, and aliases can blow up a small file.
"""

from __future__ import annotations

import re
from typing import Any, NoReturn

import yaml

from camcal.errors import UsageError

KeyPath = tuple[str, ...]
PREFIX = "tag:yaml.org,2002:"
LONGEST_INTEGER = (
    100  #: digits; Python refuses to read thousands (sys.int_info), and no setting needs so many
)
DEEPEST = 20  #: levels, more than any option has


class _Loader(yaml.SafeLoader):
    """PyYAML's scanner with the types of the YAML 1.2 core schema."""

    yaml_implicit_resolvers: dict[Any, Any] = {}  # noqa: RUF012  # PyYAML's own form; emptied of YAML 1.1


for _type, _pattern, _first in (
    ("null", r"~|null|Null|NULL|", "~nN"),
    ("bool", r"true|True|TRUE|false|False|FALSE", "tTfF"),
    ("int", r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+", "-+0123456789"),
    (
        "float",
        r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)",
        "-+.0123456789",
    ),
):
    _starts = [*_first, ""] if _type == "null" else list(_first)
    _Loader.add_implicit_resolver(PREFIX + _type, re.compile(rf"(?:{_pattern})\Z"), _starts)


def parse(text: str, path: str) -> tuple[Any, dict[KeyPath, int]]:
    """Read one YAML document.

    Parameters
    ----------
    path : str
        For messages.

    Returns
    -------
    value : None, str, int, float, bool, list or dict
    lines : dict
        The line of each key, by the keys that lead to it.

    Raises
    ------
    UsageError
        With the line, where the text is not YAML, a key occurs twice, or a feature is used that is refused.
    """
    loader = None
    try:
        _refuse_features(text, path)
        loader = _Loader(text)
        node = loader.get_single_node()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = mark.line + 1 if mark else 1
        raise UsageError(
            f"{path}:{line}: not valid YAML: {error.problem or error.context}.", _SYNTAX
        ) from None
    except yaml.reader.ReaderError as error:
        line = text[: error.position].count("\n") + 1
        raise UsageError(
            f"{path}:{line}: not valid YAML: the character {text[error.position]!r}.", _SYNTAX
        ) from None
    except (ValueError, OverflowError) as error:  # an escape such as "\\UFFFFFFFF"
        raise UsageError(f"{path}: not valid YAML: {error}.", _SYNTAX) from None
    finally:
        if loader is not None:
            loader.dispose()
    lines: dict[KeyPath, int] = {}
    return (None if node is None else _value(node, (), lines, path)), lines


_SYNTAX = "Write `key: value` lines; text with special characters needs quotes."


def _refuse_features(text: str, path: str) -> None:
    """Reject anchors, aliases, tags and deep nesting before any object is built from them."""
    depth = 0
    for event in yaml.parse(text, _Loader):
        line = event.start_mark.line + 1 if event.start_mark else 1
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
            raise UsageError(f"{path}:{line}: anchors and aliases (& and *) are not read.", "Write it out.")
        if (tag := getattr(event, "tag", None)) is not None:
            raise UsageError(
                f"{path}:{line}: the tag {tag.replace(PREFIX, '!!')} is not read.", "Remove the tag."
            )
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > DEEPEST:
            raise UsageError(f"{path}:{line}: nested more than {DEEPEST} deep.", _SYNTAX)


def _value(node: yaml.Node, keys: KeyPath, lines: dict[KeyPath, int], path: str) -> Any:
    if isinstance(node, yaml.MappingNode):
        return _mapping(node, keys, lines, path)
    if isinstance(node, yaml.SequenceNode):
        return [_value(item, (*keys, str(i)), lines, path) for i, item in enumerate(node.value)]
    kind, text = node.tag.removeprefix(PREFIX), node.value
    if kind == "int" and len(text) > LONGEST_INTEGER:
        _fail(path, node, f"a number of {len(text)} digits; a shorter one is needed")
    if kind == "int":
        return int(text, {"0x": 16, "0o": 8}.get(text[:2], 10))
    if kind == "float":
        return float(text.lower().replace(".inf", "inf").replace(".nan", "nan"))
    return {"null": None, "bool": text.lower() == "true"}.get(kind, text)


def _mapping(node: yaml.MappingNode, keys: KeyPath, lines: dict[KeyPath, int], path: str) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key_node, value_node in node.value:
        if not isinstance(key_node, yaml.ScalarNode) or key_node.tag != PREFIX + "str":
            shown = getattr(key_node, "value", None)
            _fail(
                path,
                key_node,
                f"a key is {shown if isinstance(shown, str) else 'a list'!r}; a name is needed",
            )
        key = key_node.value
        if key in found:
            first = lines[(*keys, key)]
            _fail(path, key_node, f"'{key}' is given a second time, after line {first}; once is needed")
        lines[(*keys, key)] = key_node.start_mark.line + 1
        found[key] = _value(value_node, (*keys, key), lines, path)
    return found


def _fail(path: str, node: yaml.Node, message: str) -> NoReturn:
    raise UsageError(f"{path}:{node.start_mark.line + 1}: {message}.", "Correct or remove that line.")
