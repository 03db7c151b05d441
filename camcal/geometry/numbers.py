"""Floating-point constants that several packages share, and statistics without further imports.

`np.median`, `np.unique` without indices, and `np.percentile` by it, import `numpy.ma`: 13 ms, a tenth of the time that
a command takes to start.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import overload

import numpy as np

Array = np.ndarray

#: stands for 0 as a divisor or under a logarithm: below every quantity that occurs, and its inverse is finite
TINY = 1e-300


def distinct(values: Array, axis: int | None = None) -> Array:
    """The different values of an array, ascending, as `np.unique` gives them; of rows (N, D) with `axis` 0."""
    if axis == 0:
        return values[distinct_rows(values)[0]]
    return np.asarray(np.unique(values, return_index=True)[0])


def distinct_rows(values: Array) -> tuple[Array, Array]:
    """The different rows of an array (N, D), as `np.unique` gives them in a tenth of the time.

    Returns
    -------
    first : (M,) int array
        Where each occurs first, in ascending order of the rows: by the first column, then by the second, and so on.
    number : (N,) int array
        Which of them each row is.
    """
    order = np.lexsort(values.T[::-1])
    ordered = values[order]
    new = np.ones(len(values), bool)
    new[1:] = (ordered[1:] != ordered[:-1]).any(1)
    number = np.empty(len(values), int)
    number[order] = np.cumsum(new) - 1
    return order[new], number


@overload
def median(values: Array) -> float: ...


@overload
def median(values: Array, axis: int) -> Array: ...


def median(values: Array, axis: int | None = None) -> float | Array:
    """The median of all values, or along an axis, as `np.median` gives it; NaN if one value is, or there is none."""
    ordered = np.sort(values, axis)
    if ordered.dtype.kind in "ui":  # the sum of two grey values would overflow
        ordered = ordered.astype(float)
    ordered = ordered if axis is None else np.moveaxis(ordered, axis, -1)
    count = ordered.shape[-1]
    if not count:
        return float("nan") if axis is None else np.full(ordered.shape[:-1], np.nan)
    middle = 0.5 * (ordered[..., (count - 1) // 2] + ordered[..., count // 2])
    found = np.where(np.isnan(ordered[..., -1]), np.nan, middle)  # NaN is sorted to the end
    return float(found) if axis is None else found


def percentiles(values: Array, wanted: Sequence[float]) -> list[float]:
    """Percentiles of all values of an array as `np.percentile` gives them: linear between two values; NaN if one is."""
    ordered = np.sort(values, axis=None)
    last = len(ordered) - 1
    if last < 0 or np.isnan(ordered[-1]):
        return [float("nan")] * len(wanted)
    found = []
    for share in wanted:
        place = share / 100 * last
        below = int(place)
        part = place - below
        low, high = float(ordered[below]), float(ordered[min(below + 1, last)])
        # from the nearer of the two, as numpy does
        found.append(low + (high - low) * part if part < 0.5 else high - (high - low) * (1 - part))
    return found


def lower_quartile(values: Array) -> float:
    """The largest value of the lower quarter of an array's values; NaN if it is empty."""
    ordered = np.sort(values, axis=None)
    return float(ordered[(len(ordered) - 1) // 4]) if len(ordered) else float("nan")
