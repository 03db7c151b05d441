"""Correspondences from .npz archives: flat arrays with a view per row, or one stacked array per view."""

from __future__ import annotations

import hashlib
import io

import numpy as np

from camcal.data import npz
from camcal.data.columns import plain
from camcal.data.table import LARGEST_VALUE, Table, is_id
from camcal.errors import DataError
from camcal.registry import suggestion
from camcal.system.reading import read_file

Array = np.ndarray
WRITE_IT = "Write it with numpy.savez(path, xyz=..., uv=...)."
NAMES = {
    "xyz": "xyz objectpoints objpoints objp points3d worldpoints",
    "uv": "uv imagepoints imgpoints points2d pixels",
    "view": "view views viewid viewids",
    "sigma": "sigma sigmas",
    "id": "id ids pointid pointids",
    "image_size": "imagesize imgsize",
}
_BY_NAME = {alias: role for role, text in NAMES.items() for alias in text.split()}
#: bytes of an archive: larger than its arrays may be, as numbers hardly shrink
LARGEST = npz.LARGEST + (64 << 20)


def read_archive(path: str) -> tuple[Table, tuple[int, int] | None]:
    """Read an .npz archive.

    Parameters
    ----------
    path : str
        With the arrays `xyz` (N, 3) or (N, 2) and `uv` (N, 2), optionally `view`, `sigma` and `id` (N,); or
        `uv` (V, N, 2) with `xyz` (V, N, 3) or the same (N, 3) for all views, and `view` (V,).
        `object_points` and `image_points` are other names of the first two; `image_size` is (width, height).

    Returns
    -------
    table : Table
    image_size : (width, height) or None

    Raises
    ------
    DataError
        If the archive is broken, lacks an array, or an array has the wrong shape, type or values.
    """
    data = read_file(path, LARGEST, "an .npz archive of points", "Check the name and the folder.")
    if not data:
        raise DataError(f"{path}: the file is empty (0 bytes).", WRITE_IT)
    arrays = _arrays(data, path)
    for needed in ("xyz", "uv"):
        if needed not in arrays:
            raise DataError(f"{path}: no array '{needed}'; xyz and uv are needed.", WRITE_IT)
    uv = _numeric(arrays["uv"], "uv", path)
    xyz = _numeric(arrays["xyz"], "xyz", path)
    lead = uv.shape[:-1]
    if uv.shape[-1] != 2 or len(lead) not in (1, 2) or xyz.shape[-1] not in (2, 3) or not uv.size:
        raise _bad_shapes(path, xyz, uv)
    if xyz.shape[:-1] not in (lead, lead[-1:]):
        raise _bad_shapes(path, xyz, uv)
    xyz = np.broadcast_to(xyz, (*lead, xyz.shape[-1])).reshape(-1, xyz.shape[-1])
    columns, values = list("XYZ"[: xyz.shape[-1]] + "uv"), [xyz, uv.reshape(-1, 2)]
    for role in ("sigma", "id"):
        if role in arrays:
            columns.append(role)
            values.append(_per_point(arrays[role], role, lead, path))
    names, index = _views(arrays.get("view"), lead, path)
    table = Table(
        path, hashlib.sha256(data).hexdigest(), tuple(columns), np.hstack(values), names, index, shape=lead
    )
    _check_values(table)
    return table, _image_size(arrays.get("image_size"), path)


def _arrays(data: bytes, path: str) -> dict[str, Array]:
    """The arrays by role; arrays with other names are ignored unless they look misspelt."""
    found: dict[str, str] = {}
    if data.startswith(np.lib.format.MAGIC_PREFIX):
        raise DataError(f"{path}: a single array was found; an archive is needed.", WRITE_IT)
    if not data.startswith(b"PK"):
        raise DataError(f"{path}: not an .npz archive.", WRITE_IT)
    try:
        for name in npz.names(io.BytesIO(data)):
            role = _BY_NAME.get(plain(name))
            if role is None:
                near = suggestion(plain(name), _BY_NAME)
                if near:
                    raise DataError(f"{path}: unknown array '{name}'.", near)
                continue
            if role in found:
                raise DataError(f"{path}: two arrays mean {role}; one is needed.", "Remove one.")
            found[role] = name
        given = npz.arrays(io.BytesIO(data), found.values())
    except npz.BROKEN as error:
        if "allow_pickle" in str(error):
            raise DataError(
                f"{path}: an array of Python objects; arrays of numbers are needed.",
                "Stack the views to (V, N, 2), or put them one below the other with an array `view`.",
            ) from None
        reason = str(error).partition("\n")[0].rstrip(".") or type(error).__name__
        raise DataError(f"{path}: not a readable .npz archive: {reason}.", WRITE_IT) from None
    return {role: given[name] for role, name in found.items()}


def _numeric(array: Array, name: str, path: str) -> Array:
    if array.dtype.kind not in "iuf" or array.ndim == 0:
        raise DataError(
            f"{path}: {name} holds {array.dtype} of shape {array.shape}; an array of real numbers is needed.",
            WRITE_IT,
        )
    if array.ndim > 2 and array.shape[-2] == 1:  # cv2's (N, 1, 2)
        array = array.reshape(*array.shape[:-2], array.shape[-1])
    return array.astype(float)


def _bad_shapes(path: str, xyz: Array, uv: Array) -> DataError:
    return DataError(
        f"{path}: xyz {xyz.shape} and uv {uv.shape} do not match; (N, 3) and (N, 2) are needed.",
        "(V, N, 3) and (V, N, 2) are accepted too, for V views of N points each.",
    )


def _per_point(array: Array, name: str, lead: tuple[int, ...], path: str) -> Array:
    """A value for each point, (M, 1), from a single value, one per point of the target, or all values."""
    values = array.astype(float) if array.dtype.kind in "iuf" else None
    if values is None or values.shape not in ((), lead, lead[-1:]):
        raise DataError(
            f"{path}: {name} holds {array.dtype} of shape {array.shape}; numbers of shape {lead} are needed.",
            "Give one for each row of uv.",
        )
    return np.broadcast_to(values, lead).reshape(-1, 1)


def _views(array: Array | None, lead: tuple[int, ...], path: str) -> tuple[tuple[str, ...], Array | None]:
    """The names of the views and the view of each row; without names, stacked views are numbered."""
    if array is None:
        if len(lead) == 1:
            return (), None
        array = np.array([f"view{i + 1}" for i in range(lead[0])])
    if array.shape != lead[:1] or array.dtype.kind not in "iuUS":
        raise DataError(
            f"{path}: view holds {array.dtype} of shape {array.shape}; names or whole numbers of shape "
            f"{lead[:1]} are needed.",
            "Give one for each row of uv.",
        )
    words = np.char.decode(array, "utf-8", "replace") if array.dtype.kind == "S" else array
    texts = [str(word).strip() for word in words.tolist()]
    numbers = {name: i for i, name in enumerate(dict.fromkeys(texts))}
    if "" in numbers:
        raise DataError(f"{path}: view[{texts.index('')}] is empty; a name is needed.", "Fill in the view.")
    if len(lead) == 2 and len(numbers) < len(texts):
        raise DataError(
            f"{path}: {len(texts)} stacked views were found, but {len(numbers)} names.",
            "Give each view a name of its own.",
        )
    index = np.fromiter(map(numbers.__getitem__, texts), np.int32, len(texts))
    return tuple(numbers), np.repeat(index, lead[1]) if len(lead) == 2 else index


def _check_values(table: Table) -> None:
    for i, name in enumerate(table.columns):
        values = table.values[:, i]
        good = np.abs(values) <= LARGEST_VALUE  # NaN is not
        needed = f"a finite number below {LARGEST_VALUE:g} is"
        if name == "sigma":
            good, needed = good & (values > 0), "a number above 0 is"
        if name == "id":
            good, needed = good & is_id(values), "a whole number is"
        if not good.all():
            row = int(np.flatnonzero(~good)[0])
            raise DataError(
                f"{table.where(row)}: {name} is {values[row]:g}; {needed} needed.",
                "Leave out points that were not seen; with an array `view` the views may have different "
                "numbers of points.",
            )


def _image_size(array: Array | None, path: str) -> tuple[int, int] | None:
    if array is None:
        return None
    if array.shape != (2,) or array.dtype.kind not in "iuf" or not (is_id(array) & (array > 0)).all():
        raise DataError(f"{path}: image_size is {array.tolist()}; (width, height) in px is needed.", WRITE_IT)
    return int(array[0]), int(array[1])
