"""The observations inside a report, without loss of precision.

    data: {encoding: zlib+base64, dtype: float64, byteorder: little, columns: [...], rows: n, text: ...}

The text holds the columns concatenated (each `rows` little-endian doubles), compressed by zlib. `view`
is an index into the report's `views`, `id` the number of the target's point (-1: none), `sigma` NaN if
none was given, `used` 0 for a rejected point; a column `weight` follows if a robust loss weighted the
points. Rows are in the order of the views, and of the points in each.
"""

from __future__ import annotations

import base64
import binascii
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from camcal.data.observations import NO_ID, Observations
from camcal.errors import DataError
from camcal.schema.views import Data

Array = np.ndarray

COLUMNS = ("view", "id", "X", "Y", "Z", "u", "v", "sigma", "used")
WEIGHT = "weight"
ENCODING = "zlib+base64"
_WRAP = 100
BYTES = 8  #: of a number of the table
#: bytes of the table, unpacked: 10 million rows
LARGEST = 800_000_000


def encode(data: Observations, places: Sequence[int]) -> dict[str, Any]:
    """The `data` entry of observations; `places` are the indices of their views in the report."""
    rows = data.point_count
    columns = COLUMNS if data.weight is None else (*COLUMNS, WEIGHT)
    table = np.empty((len(columns), rows), "<f8")
    table[0] = np.asarray(places, float)[data.view]
    table[1] = -1.0 if data.point is None else np.where(data.point == NO_ID, -1, data.point)
    table[2:5] = data.xyz.T
    table[5:7] = data.uv.T
    table[7] = np.nan if data.sigma is None else data.sigma
    table[8] = data.used
    if data.weight is not None:
        table[9] = data.weight
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


def decode(data: Data, ids: Sequence[str]) -> tuple[Observations, list[int]]:
    """The observations of a `data` entry and the indices of their views in the report; the inverse of `encode`.

    Parameters
    ----------
    data : Data
    ids : sequence of str
        The ids of the report's `views`.

    Raises
    ------
    DataError
        If the entry is damaged.
    """
    table = _table(data)
    place = table["view"].astype(int)
    if len(place) and (place.min() < 0 or place.max() >= len(ids)):
        raise DataError("the report's data name a view that it does not list.", "The file is damaged.")
    starts = np.flatnonzero(np.diff(place, prepend=-1))
    places = place[starts].tolist()
    view = np.cumsum(np.diff(place, prepend=place[0] if len(place) else 0) != 0)
    found = Observations(
        xyz=np.stack([table[c] for c in "XYZ"], 1),
        uv=np.stack([table[c] for c in "uv"], 1),
        view=view,
        view_ids=tuple(ids[i] for i in places),
        camera=np.zeros(len(view), int),
        point=None if (table["id"] < 0).all() else table["id"].astype(int),
        sigma=None if np.isnan(table["sigma"]).all() else table["sigma"].copy(),
        weight=table[WEIGHT].copy() if WEIGHT in table else None,
    )
    return found.with_used(table["used"] > 0), places


def _table(data: Data) -> dict[str, Array]:
    missing = [c for c in COLUMNS if c not in data.columns]
    if missing:
        raise DataError(f"the report's data lack the column '{missing[0]}'.", "The file is damaged.")
    count = len(data.columns) * data.rows
    if BYTES * count > LARGEST:
        raise DataError(
            f"the report's data claim {data.rows} rows; at most {LARGEST // BYTES // len(data.columns)} are read.",
            "The file is damaged.",
        )
    try:
        packed = base64.b64decode(data.text)
        # no more than the rows need: a few bytes could expand to more than fits in memory
        raw = zlib.decompressobj().decompress(packed, BYTES * count + 1)
    except (ValueError, binascii.Error, zlib.error) as error:
        raise DataError(f"the report's data are damaged ({error}).", "Is the file truncated?") from error
    if len(raw) != BYTES * count:
        raise DataError(
            f"the report's data are damaged: not {data.rows} rows of {len(data.columns)} columns.",
            "Is the file truncated?",
        )
    values = np.frombuffer(raw, "<f8").astype(float).reshape(len(data.columns), data.rows)
    table = dict(zip(data.columns, values, strict=True))
    for name in (c for c in COLUMNS if c != "sigma"):
        if not np.isfinite(table[name]).all():
            raise DataError(
                f"the report's data hold a value of '{name}' that is not finite.", "The file is damaged."
            )
    return table
