"""The results of all jobs, packed to some hundred bytes per job, so that memory does not limit their number."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, overload

import msgspec

Row = dict[str, Any]

#: numbers of numpy are floats to it in name only
_ENCODER = msgspec.msgpack.Encoder(enc_hook=float)
_DECODER = msgspec.msgpack.Decoder(list[Any])
#: the keys that rows have, which many share: a row holds their number
_numbers: dict[tuple[str, ...], int] = {}
_keys: list[tuple[str, ...]] = []


def packed(row: Row) -> bytes:
    """A row as it is kept: about 200 bytes, where a dict with its values has 2 kB."""
    keys = tuple(row)
    number = _numbers.setdefault(keys, len(_keys))
    if number == len(_keys):
        _keys.append(keys)
    return _ENCODER.encode([number, *row.values()])


def unpacked(kept: bytes) -> Row:
    """The row that was packed, by this process."""
    number, *values = _DECODER.decode(kept)
    return dict(zip(_keys[number], values, strict=True))


class Rows(Sequence[Row]):
    """Rows in the order of the jobs; each is unpacked on access, so that changes to it are lost.

    Parameters
    ----------
    kept : sequence of bytes
        Of `packed`.
    """

    def __init__(self, kept: Sequence[bytes]):
        self._kept = kept

    @classmethod
    def of(cls, rows: Iterable[Row]) -> Rows:
        """Pack rows as they come."""
        return cls([packed(row) for row in rows])

    def __len__(self) -> int:
        return len(self._kept)

    @overload
    def __getitem__(self, index: int) -> Row: ...

    @overload
    def __getitem__(self, index: slice) -> Rows: ...

    def __getitem__(self, index: int | slice) -> Row | Rows:
        if isinstance(index, slice):
            return Rows(self._kept[index])
        return unpacked(self._kept[index])

    def __iter__(self) -> Iterator[Row]:
        return map(unpacked, self._kept)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and list(self) == list(other)

    __hash__ = None  # type: ignore[assignment]  # as a list
