"""Archives of numpy arrays (.npz): decompression is limited in total and by each array's stated size."""

from __future__ import annotations

import io
import math
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Collection
from typing import BinaryIO

import numpy as np

Array = np.ndarray

#: bytes of all arrays that are taken from one archive: 13 million points of five numbers
LARGEST = 512 << 20
#: what zipfile, zlib and numpy raise on damaged archives
BROKEN = (
    *(OSError, ValueError, EOFError, KeyError, NotImplementedError, RuntimeError, MemoryError, OverflowError),
    *(zipfile.BadZipFile, zlib.error, struct.error, SyntaxError, tokenize.TokenError, TypeError, IndexError),
)


def names(stream: BinaryIO) -> list[str]:
    """The names of the arrays; an error of `BROKEN` if the file is not an archive."""
    with zipfile.ZipFile(stream) as archive:
        return [n.removesuffix(".npy") for n in archive.namelist()]


def arrays(stream: BinaryIO, wanted: Collection[str], most: int = LARGEST) -> dict[str, Array]:
    """The arrays of these names.

    Raises
    ------
    one of BROKEN
        Where the archive is damaged; ValueError where an array holds Python objects, or the arrays are larger
        than `most` bytes together.
    """
    found: dict[str, Array] = {}
    with zipfile.ZipFile(stream) as archive:
        entries = {e.filename.removesuffix(".npy"): e for e in archive.infolist()}
        # what a zip entry gives is never more than the size that it states
        total = sum(entries[name].file_size for name in wanted)
        if total > most:
            raise ValueError(f"its arrays have {total >> 20} MB; at most {most >> 20} MB are read")
        for name in wanted:
            with archive.open(entries[name]) as entry:
                found[name] = _array(entry.read())
    return found


def _array(data: bytes) -> Array:
    """An array from the bytes of a .npy file, whose header must state the size that follows."""
    stream = io.BytesIO(data)
    version = np.lib.format.read_magic(stream)
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f"an array of version {version[0]}.{version[1]}")
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, fortran, kind = read(stream)
    if kind.hasobject:
        raise ValueError("an array of Python objects (allow_pickle)")
    size = kind.itemsize * math.prod(shape)
    if any(n < 0 for n in shape) or size != len(data) - stream.tell():
        raise ValueError(f"an array of {shape} with {len(data) - stream.tell()} bytes")
    values = np.frombuffer(data, kind, offset=stream.tell()) if size else np.zeros(math.prod(shape), kind)
    return values.reshape(shape, order="F" if fortran else "C").copy()
