"""Variables of MATLAB files: version 5, and version 7.3 (HDF5) by h5py where it is installed."""

from __future__ import annotations

import io
import struct
import zlib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from camcal.data.formats import mat5
from camcal.errors import DataError

V7 = "In MATLAB: save('camera.mat', '-v7', ...)"
DEEPEST = 3  #: structs inside each other: a pair, its cameras, their parts
AS_STRUCT = "In MATLAB: s = toStruct(params); save('camera.mat', '-v7', 's')"


def variables(data: bytes, path: Path, kind: str) -> dict[str, Any]:
    """Variables by name: arrays, text, structs as objects with their fields as attributes, None for objects."""
    if kind == "hdf5":
        return _of_hdf5(data, path)
    try:
        return mat5.read(data)
    except (ValueError, struct.error, zlib.error, OverflowError, MemoryError) as error:
        raise DataError(f"'{path}' is not readable as a MATLAB file: {_line(error)}.", V7) from None


def _line(error: Exception) -> str:
    return str(error).partition("\n")[0].rstrip(".") or type(error).__name__


def _of_hdf5(data: bytes, path: Path) -> dict[str, Any]:
    try:
        import h5py
    except ImportError:
        raise DataError(
            f"'{path}' is a MATLAB file of version 7.3 (HDF5), which needs the package h5py.",
            f"pip install h5py, or {V7[0].lower() + V7[1:]}",
        ) from None
    try:
        with h5py.File(io.BytesIO(data), "r") as file:
            return {name: _hdf5_value(file[name]) for name in file if not name.startswith("#")}
    except Exception as error:  # noqa: BLE001  # HDF5 raises almost anything on a damaged file
        raise DataError(f"'{path}' is not readable as a MATLAB file: {_line(error)}.", V7) from None


def _hdf5_value(node: Any, depth: int = 0) -> Any:
    """An array with MATLAB's order of axes, a text, or a struct; None for an object or a cell."""
    kind = node.attrs.get("MATLAB_class", b"")
    kind = kind.decode() if isinstance(kind, bytes) else str(kind)
    if hasattr(node, "keys"):
        if kind not in ("struct", "") or depth > DEEPEST:
            return None
        return SimpleNamespace(**{name: _hdf5_value(node[name], depth + 1) for name in node})
    values = node[()]
    if kind == "char":
        return "".join(map(chr, np.ravel(values)))
    if "MATLAB_object_decode" in node.attrs or np.asarray(values).dtype.kind not in "iufb":
        return None
    if node.attrs.get("MATLAB_empty"):
        return np.zeros(0)
    return np.squeeze(np.asarray(values).T)
