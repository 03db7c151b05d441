"""Conversion into plain Python types, which YAML and JSON hold without loss."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import PurePath
from typing import Any

import numpy as np

from camcal.system.text import readable


def plain(value: Any) -> Any:
    """Mappings, sequences, arrays, numpy's scalars, paths and dataclasses as dict, list, str and numbers.

    Infinite values and NaN are kept: the writers represent them as each format requires.

    Raises
    ------
    TypeError
        For anything else: a report must not hold the `repr` of an object.
    """
    if isinstance(value, str):
        return readable(value)
    if value is None or isinstance(value, bool) or type(value) in (int, float):
        return value
    if isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
        return value.tolist()
    if isinstance(value, (dict, Mapping)):
        return {readable(str(k)): plain(v) for k, v in value.items()}
    if isinstance(value, (np.ndarray, np.generic)):
        return plain(value.tolist())
    if isinstance(value, (list, tuple, set, frozenset)):
        return [plain(v) for v in (sorted(value) if isinstance(value, (set, frozenset)) else value)]
    if isinstance(value, PurePath):
        return readable(str(value))
    if is_dataclass(value) and not isinstance(value, type):
        return {f.name: plain(getattr(value, f.name)) for f in fields(value)}
    if isinstance(value, (int, float)):  # subclasses: enums and the like
        return plain(float(value) if isinstance(value, float) else int(value))
    raise TypeError(f"a report cannot hold a {type(value).__name__}")
