"""Inputs that are damaged or made to do harm, from inputs that are read: bytes, numbers and parts of documents."""

from __future__ import annotations

import json
import random
import re
from typing import Any

import yaml

NUMBERS = [
    "nan",
    "inf",
    "-inf",
    "1e400",
    "-1",
    "0",
    "1e308",
    "1e-320",
    "9" * 400,
    "2147483648",
    "-0.0",
    "1e75",
]
SCRAPS = [
    b"\n",
    b"\r",
    b"\0",
    b"\xff",
    b",",
    b";",
    b"[",
    b"{",
    b"]",
    b"'",
    b'"',
    b"*a",
    b"&a ",
    b"!!python/name:os.x ",
]
SCRAPS += [
    b"\x1b[31m",
    "\u202e".encode(),
    b"=1+1",
    b"<a>",
    b"&b;",
    b": ",
    b"- ",
    b"#",
    b"\t",
    b"[" * 200,
    b"null",
]
VALUES: list[Any] = [
    None,
    True,
    -1,
    0,
    1e308,
    float("nan"),
    float("inf"),
    10**400,
    "",
    "x",
    [],
    {},
    [[]],
    {"a": 1},
]
VALUES += [[1, 2], "\x1b[31m", "a" * 2000, 2**63, -5.5, [None] * 3]
_NUMBER = re.compile(rb"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")


def mutated(data: bytes, rng: random.Random) -> bytes:
    """One of the kinds of damage, or a few together."""
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        data = rng.choice((_bytes, _bytes, _number, _cut, _scrap, _lines, _part, _part))(data, rng)
    return data


def _bytes(data: bytes, rng: random.Random) -> bytes:
    out = bytearray(data)
    for _ in range(rng.choice((1, 3, 20)) if out else 0):
        out[rng.randrange(len(out))] = rng.randrange(256)
    return bytes(out)


def _cut(data: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(data) + 1)
    return data[:at] if rng.random() < 0.5 else data[:at] + data[at + rng.randrange(1, 60) :]


def _scrap(data: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(data) + 1)
    return data[:at] + rng.choice(SCRAPS) + data[at:]


def _number(data: bytes, rng: random.Random) -> bytes:
    found = list(_NUMBER.finditer(data[:200_000]))
    if not found:
        return _scrap(data, rng)
    at = rng.choice(found)
    return data[: at.start()] + rng.choice(NUMBERS).encode() + data[at.end() :]


def _lines(data: bytes, rng: random.Random) -> bytes:
    """A line repeated, left out, or exchanged with another."""
    lines = data.split(b"\n")
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    kind = rng.randrange(3)
    if kind == 0:
        lines.insert(i, lines[j])
    elif kind == 1:
        del lines[i]
    else:
        lines[i], lines[j] = lines[j], lines[i]
    return b"\n".join(lines)


def _part(data: bytes, rng: random.Random) -> bytes:
    """A value of a document replaced, removed, or repeated; bytes where it is no document."""
    head, body = b"", data
    if data.startswith(b'{"schema": "camcal-track'):  # a checkpoint: a line before its document
        head, _, body = data.partition(b"\n")
        head += b"\n"
    elif data.lstrip()[:1] not in (b"{", b"s", b"c", b"j", b"t", b"m", b"i") or b":" not in data[:400]:
        return _number(data, rng)
    try:
        is_json = body.lstrip().startswith(b"{")
        tree = json.loads(body) if is_json else yaml.load(body, getattr(yaml, "CSafeLoader", yaml.SafeLoader))
        _change(tree, rng)
        text = json.dumps(tree) if is_json else yaml.safe_dump(tree, sort_keys=False)
    except (ValueError, TypeError, yaml.YAMLError, RecursionError, AttributeError):
        return _number(data, rng)
    return head + text.encode()


def _change(tree: Any, rng: random.Random) -> None:
    places = [(p, k) for p in _containers(tree) for k in (p if isinstance(p, dict) else range(len(p)))]
    for _ in range(rng.choice((1, 1, 3)) if places else 0):
        parent, key = rng.choice(places)
        kind = rng.randrange(5)
        try:
            if kind == 0:
                del parent[key]
            elif kind == 1 and isinstance(parent, list):
                parent.append(parent[key])
            elif kind == 2:
                other, name = rng.choice(places)
                parent[key] = other[name] if other[name] is not parent else None
            else:
                parent[key] = rng.choice(VALUES)
        except (KeyError, IndexError):
            continue


def _containers(tree: Any, depth: int = 0) -> list[Any]:
    if not isinstance(tree, (dict, list)) or depth > 12:
        return []
    parts = tree.values() if isinstance(tree, dict) else tree
    return [tree, *(c for part in list(parts)[:60] for c in _containers(part, depth + 1))]
