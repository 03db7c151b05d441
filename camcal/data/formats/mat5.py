"""MATLAB files of version 5 (-v6, -v7): numbers, text and structs.

MathWorks, MAT-file format, chapter 1. A reader of camcal's own, because scipy's ends the process on some
damaged files; objects, sparse matrices and functions are None.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np

#: bytes of a decompressed variable
LARGEST = 256 << 20
DEEPEST = 8  #: structs and cells inside each other; deeper files are damaged or hostile
#: storage type -> numpy's type
NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
NUMBERS |= {16: "u1", 17: "u2"}
MATRIX, COMPRESSED, UTF8, UTF16 = 14, 15, 16, 17
CELL, STRUCT, TEXT, FIRST_NUMBER, LAST_NUMBER = 1, 2, 4, 6, 15
COMPLEX = 0x0800


class Elements:
    """The data elements of a byte string, in sequence."""

    def __init__(self, data: bytes, order: str):
        self.data, self.order, self.at = data, order, 0

    def more(self) -> bool:
        """Return whether another element follows."""
        return self.at + 8 <= len(self.data)

    def next(self) -> tuple[int, bytes]:
        """The type and content of the next element; ValueError if it exceeds the data."""
        if not self.more():
            raise ValueError("a variable ends too early")
        kind, size = struct.unpack_from(f"{self.order}II", self.data, self.at)
        if kind >> 16:  # the small form: type, size and up to four bytes in one word pair
            kind, size, start, end = kind & 0xFFFF, kind >> 16, self.at + 4, self.at + 8
        else:
            start = self.at + 8
            end = start + size + (0 if kind == COMPRESSED else -size % 8)
        if start + size > len(self.data) or size > end - start:
            raise ValueError("a variable ends too early")
        self.at = end
        return kind, self.data[start : start + size]

    def numbers(self) -> np.ndarray:
        """The next element as numbers."""
        kind, content = self.next()
        if kind not in NUMBERS:
            raise ValueError("numbers of an unknown type")
        return np.frombuffer(content, np.dtype(self.order + NUMBERS[kind]))


def read(data: bytes) -> dict[str, Any]:
    """The variables of a file by name.

    Raises
    ------
    ValueError, struct.error, zlib.error
        Where the file is damaged.
    """
    order = {b"IM": "<", b"MI": ">"}.get(data[126:128])
    if order is None:
        raise ValueError("it is of version 4 or damaged")
    found = {}
    for content in _variables(Elements(data[128:], order)):
        name, value = _matrix(Elements(content, order), 0)
        if name:  # without one it is the objects' own workspace
            found[name] = value
    return found


def _variables(elements: Elements) -> Iterator[bytes]:
    while elements.more():
        kind, content = elements.next()
        if kind == COMPRESSED:
            unpacker = zlib.decompressobj()
            unpacked = unpacker.decompress(content, LARGEST)
            if unpacker.unconsumed_tail:
                raise ValueError(f"a variable has more than {LARGEST >> 20} MB")
            kind, content = Elements(unpacked, elements.order).next()
        if kind == MATRIX:
            yield content


def _matrix(parts: Elements, depth: int) -> tuple[str, Any]:
    """Name and value of a matrix element."""
    flags = parts.numbers()
    if len(flags) < 1 or depth > DEEPEST:
        raise ValueError("a variable without a class")
    kind = int(flags[0]) & 0xFF
    if kind > LAST_NUMBER:  # functions and objects have no size
        return _text(parts.next()), None
    shape = tuple(int(n) for n in parts.numbers())
    if any(n < 0 for n in shape) or len(shape) < 2:
        raise ValueError("a variable of negative size")
    name = _text(parts.next())
    if kind == STRUCT:
        return name, _struct(parts, shape, depth)
    if kind == CELL:
        return name, _cell(parts, shape, depth)
    if kind == TEXT:
        return name, _text(parts.next())
    if kind < FIRST_NUMBER or int(flags[0]) & COMPLEX:
        return name, None
    values = parts.numbers()
    if len(values) != int(np.prod(shape, dtype=object)):
        raise ValueError(f"{len(values)} numbers for a variable of {shape}")
    return name, np.squeeze(values.reshape(shape, order="F").astype(float))


def _text(part: tuple[int, bytes]) -> str:
    kind, content = part
    if kind in (4, UTF16):
        return content.decode("utf-16-le", "replace")
    return content.decode("utf-8" if kind == UTF8 else "latin-1", "replace")


def _cell(parts: Elements, shape: tuple[int, ...], depth: int) -> list[Any]:
    """The values of a cell array, column by column."""
    count = int(np.prod(shape, dtype=object))
    if count * 8 > len(parts.data):
        raise ValueError("a cell array ends too early")
    found = []
    for _ in range(count):
        kind, content = parts.next()
        if kind != MATRIX:
            raise ValueError("a cell is not a variable")
        found.append(_matrix(Elements(content, parts.order), depth + 1)[1] if content else np.zeros(0))
    return found


def _struct(parts: Elements, shape: tuple[int, ...], depth: int) -> Any:
    """The fields as attributes; a list for an array of structs."""
    width = int(parts.numbers()[0])
    _, names = parts.next()
    if width < 1 or len(names) % width:
        raise ValueError("a struct has no field names")
    fields = [names[i : i + width].split(b"\0")[0].decode("latin-1") for i in range(0, len(names), width)]
    count = int(np.prod(shape, dtype=object))
    if fields and count * len(fields) * 8 > len(parts.data):
        raise ValueError("a struct ends too early")
    found = []
    for _ in range(count if fields else 0):
        made = SimpleNamespace()
        for field in fields:
            kind, content = parts.next()
            if kind != MATRIX:
                raise ValueError("a field is not a variable")
            setattr(
                made, field, _matrix(Elements(content, parts.order), depth + 1)[1] if content else np.zeros(0)
            )
        found.append(made)
    return found[0] if len(found) == 1 else found
