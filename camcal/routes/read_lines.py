"""Images of straight lines from tables and from pictures."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from camcal.data.labelled import read_labelled
from camcal.detect.decode import UnreadableError, decode_gray
from camcal.detect.lines import LEAST_LENGTH, find_lines
from camcal.detect.listing import list_pictures, view_ids
from camcal.detect.sources import read_bytes
from camcal.errors import DataError
from camcal.model.pose import Array
from camcal.routes.line_geometry import Lines

TABLES = (".csv", ".txt", ".tsv", ".dat")


def read_lines(
    paths: Sequence[str | os.PathLike], image_size: tuple[int, int] | None = None
) -> tuple[Lines, bool]:
    """Read lines; also return whether they were found in pictures.

    Parameters
    ----------
    paths : sequence of path
        Tables `line,u,v[,view]`, or pictures of one size.
    image_size : (width, height), optional
        Of the pictures in which the points of a table were measured; by default the smallest that contains all points.

    Raises
    ------
    DataError
        If a file cannot be read, pictures differ in size, or no line is found.
    """
    if all(Path(p).suffix.lower() in TABLES for p in paths):
        return _of_tables(paths, image_size), False
    return _of_pictures(list_pictures(paths), image_size), True


def _of_tables(paths: Sequence[str | os.PathLike], image_size: tuple[int, int] | None) -> Lines:
    parts: list[Array] = []
    names: list[str] = []
    for path in paths:
        table = read_labelled(path, ("line",), optional=("view",))
        prefix = f"{Path(path).name}:" if len(paths) > 1 else ""
        index = table.labels["line"]
        views = table.labels.get("view")
        if views is not None:  # the same name in another picture is another line
            index = views * len(table.names["line"]) + index
        for key in dict.fromkeys(index.tolist()):
            rows = np.flatnonzero(index == key)
            view = "" if views is None else table.names["view"][views[rows[0]]] + ":"
            parts.append(table.uv[rows])
            names.append(prefix + view + table.names["line"][table.labels["line"][rows[0]]])
    size = image_size
    if size is None:
        u, v = np.ceil(np.concatenate(parts).max(0)).astype(int) + 1
        size = (int(u), int(v))
    return Lines.of(parts, names, size)


def same_size(path: Path, gray: Array, size: tuple[int, int] | None) -> tuple[int, int]:
    """The size of a picture; DataError if it is not `size`."""
    own = (gray.shape[1], gray.shape[0])
    if size is not None and own != tuple(size):
        raise DataError(
            f"'{path}' has {own[0]}x{own[1]} px; {size[0]}x{size[1]} is needed.",
            "All pictures of a camera must have the same size.",
        )
    return own


def _of_pictures(paths: list[Path], image_size: tuple[int, int] | None) -> Lines:
    parts: list[Array] = []
    names: list[str] = []
    size = image_size
    for path, name in zip(paths, view_ids(paths), strict=True):
        gray = read_gray(path)
        size = same_size(path, gray, size)
        found = find_lines(gray)
        parts += found
        names += [f"{name}:{i + 1}" for i in range(len(found))]
    if not parts:
        least = LEAST_LENGTH * float(np.hypot(*size)) if size else 0
        raise DataError(
            f"no line of {least:.0f} px or more is found in {len(paths)} picture{'s' * (len(paths) != 1)}.",
            "Photograph taut strings, a printed grid, or long edges of a building.",
        )
    return Lines.of(parts, names, size)


def read_gray(path: Path, table: str = "line,u,v") -> Array:
    """A picture in grey; DataError if the file is not a picture, which names the `table` that is read as well."""
    try:
        return decode_gray(read_bytes(path))
    except UnreadableError as error:
        raise DataError(f"cannot read '{path}': {error}.", f"Give a picture, or a table {table}.") from error
