"""The observations inside a report, exact to the last bit.

    data: {encoding: zlib+base64, dtype: float64, byteorder: little, columns: [...], rows: n, text: ...}

The text holds the columns one after the other (each `rows` little-endian doubles), compressed by zlib. `view`
is an index into the report's `views`, `id` the number of the target's point (-1: none), `sigma` NaN where
none was given, `used` 0 for a rejected point; a column `weight` follows where a robust loss weighted the
points. Rows stand in the order of the views, and of the points in each.
"""

from __future__ import annotations

import base64
import binascii
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from camcal.data.observations import View
from camcal.errors import DataError

Array = np.ndarray

COLUMNS = ("view", "id", "X", "Y", "Z", "u", "v", "sigma", "used")
WEIGHT = "weight"
ENCODING = "zlib+base64"
_WRAP = 100


def encode(
    views: Sequence[View],
    used: Sequence[Array],
    places: Sequence[int],
    weights: Sequence[Array] | None = None,
) -> dict[str, Any]:
    """The `data` entry of views, masks of used points and weights; `places` are the indices in the report."""
    counts = [len(v) for v in views]
    rows = sum(counts)
    columns = COLUMNS if weights is None else (*COLUMNS, WEIGHT)
    table = np.empty((len(columns), rows), "<f8")
    table[0] = np.repeat(np.asarray(places, float), counts)
    if rows:
        table[1] = np.concatenate([_or(v.point_ids, -1.0, len(v)) for v in views])
        table[2:5] = np.concatenate([v.xyz for v in views]).T
        table[5:7] = np.concatenate([v.uv for v in views]).T
        table[7] = np.concatenate([_or(v.sigma, np.nan, len(v)) for v in views])
        table[8] = np.concatenate(list(used))
        if weights is not None:
            table[9] = np.concatenate(list(weights))
    text = base64.b64encode(zlib.compress(table.tobytes(), 6)).decode("ascii")
    wrapped = "\n".join(text[i : i + _WRAP] for i in range(0, len(text), _WRAP)) + "\n"
    return {
        "encoding": ENCODING,
        "dtype": "float64",
        "byteorder": "little",
        "columns": list(columns),
        "rows": rows,
        "text": wrapped,
    }


def _or(values: Array | None, default: float, count: int) -> Array:
    return np.full(count, default) if values is None else np.asarray(values, float)


@dataclass(frozen=True)
class Observations:
    """What `decode` finds: per used view its place in the report, the view, its mask, perhaps its weights."""

    places: list[int]
    views: list[View]
    used: list[Array]
    weights: list[Array] | None


def decode(data: Mapping[str, Any], ids: Sequence[str]) -> Observations:
    """The observations of a `data` entry; the inverse of `encode`.

    Parameters
    ----------
    data : mapping
    ids : sequence of str
        The ids of the report's `views`.

    Raises
    ------
    DataError
        Where the entry is damaged.
    """
    table = _table(data)
    place = table["view"].astype(int)
    if len(place) and (place.min() < 0 or place.max() >= len(ids)):
        raise DataError("the report's data name a view that it does not list.", "The file is damaged.")
    starts = np.flatnonzero(np.diff(place, prepend=-1))
    views, used = [], []
    xyz = np.stack([table[c] for c in "XYZ"], 1)
    uv = np.stack([table[c] for c in "uv"], 1)
    for begin, end in zip(starts, [*starts[1:], len(place)], strict=True):
        rows = slice(begin, end)
        point_ids = None if (table["id"][rows] < 0).all() else table["id"][rows].astype(int)
        sigma = None if np.isnan(table["sigma"][rows]).all() else table["sigma"][rows].copy()
        views.append(View(ids[place[begin]], xyz[rows], uv[rows], sigma, point_ids))
        used.append(table["used"][rows] > 0)
    weights = np.split(table[WEIGHT], starts[1:]) if WEIGHT in table else None
    return Observations(place[starts].tolist(), views, used, weights)


def _table(data: Mapping[str, Any]) -> dict[str, Array]:
    try:
        if data["encoding"] != ENCODING or data["dtype"] != "float64":
            found = f"{data['encoding']} of {data['dtype']}"
            raise DataError(
                f"the report's data are {found}; {ENCODING} of float64 is needed.", "Try a newer camcal."
            )
        columns, rows = list(data["columns"]), int(data["rows"])
        raw = zlib.decompress(base64.b64decode(data["text"]))
        values = np.frombuffer(raw, "<f8").astype(float).reshape(len(columns), rows)
        missing = [c for c in COLUMNS if c not in columns]
    except (KeyError, TypeError, ValueError, binascii.Error, zlib.error) as error:
        raise DataError(
            f"the report's data are damaged ({type(error).__name__}: {error}).",
            "Is the file cut off?",
        ) from error
    if missing:
        raise DataError(f"the report's data lack the column '{missing[0]}'.", "The file is damaged.")
    return dict(zip(columns, values, strict=True))
