"""Batches: arrays, or named tuples of arrays, with the members along the first axis."""

from __future__ import annotations

from typing import Any

import numpy as np

Array = np.ndarray


def rows_of(batch: Any, mask: Array) -> Any:
    """Return the masked members of an array or a named tuple of arrays; the same object if all are masked."""
    if mask.all():
        return batch
    return batch[mask] if isinstance(batch, np.ndarray) else batch._make(a[mask] for a in batch)


def merged(mask: Array, new: Any, old: Any) -> Any:
    """Return the members of `new` where the mask is set and those of `old` elsewhere."""
    if not mask.any():
        return old
    if isinstance(new, np.ndarray):
        return np.where(mask.reshape(-1, *[1] * (new.ndim - 1)), new, old)
    return new._make(merged(mask, a, b) for a, b in zip(new, old, strict=True))


def copied(batch: Any) -> Any:
    """Return a writable copy."""
    return batch.copy() if isinstance(batch, np.ndarray) else batch._make(a.copy() for a in batch)


def put(whole: Any, at: Array, part: Any) -> None:
    """Write members into a batch."""
    pairs = [(whole, part)] if isinstance(whole, np.ndarray) else zip(whole, part, strict=True)
    for a, b in pairs:
        a[at] = b
