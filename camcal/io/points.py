"""Correspondences from files: text tables, pairs of tables, and .npz archives."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from camcal.errors import UsageError
from camcal.io.columns import POINTS
from camcal.io.pairs import read_pair
from camcal.io.table import Table, read_table
from camcal.types import Correspondences, View

Array = np.ndarray
PathLike = str | os.PathLike


def read_points(
    *paths: PathLike,
    points3d: PathLike | None = None,
    points2d: PathLike | None = None,
    image_size: tuple[int, int] | None = None,
) -> Correspondences:
    """Read correspondences of 3D points and pixels.

    Parameters
    ----------
    *paths : path
        Tables with or without a header, or `.npz` archives; docs/input-formats.md describes them. A file
        without a view column is one view and names it. Views of different files are different views.
    points3d, points2d : path
        Instead: two tables whose rows correspond, one of points in the world and one of pixels.
    image_size : (width, height), optional
        Of the pictures, px. An archive may bring its own.

    Returns
    -------
    Correspondences
        Views in the order of first appearance; `files` holds path and sha256 of each file.

    Raises
    ------
    DataError
        With file and line: what was found and what is needed.
    UsageError
        Where no file is given, only one of a pair, or both kinds.
    """
    if points3d is not None or points2d is not None:
        if paths or points3d is None or points2d is None:
            raise UsageError(
                "points come from tables of X Y Z u v, or from one file of 3D and one of 2D points.",
                "Give --points3d and --points2d and no other file, or give neither.",
            )
        table, parts = read_pair(os.fspath(points3d), os.fspath(points2d))
        files = [{"path": part.path, "sha256": part.sha256} for part in parts]
        return Correspondences.from_views(views_of(table), image_size, files=tuple(files))
    if not paths:
        raise UsageError("no file of points is given.", "Name a CSV file, or --points3d and --points2d.")
    views: list[View] = []
    files = []
    for path in paths:
        table = read_table(os.fspath(path), POINTS)
        views.extend(views_of(table))
        files.append({"path": table.path, "sha256": table.sha256})
    return Correspondences.from_views(views, image_size, files=tuple(files))


def views_of(table: Table) -> list[View]:
    """The views of a table, in the order of first appearance."""
    n = len(table.values)
    xyz = np.zeros((n, 3))
    uv = np.empty((n, 2))
    for target, names in ((xyz, "XYZ"), (uv, "uv")):
        for k, name in enumerate(names):
            column = table.column(name)
            if column is not None:
                target[:, k] = column
    sigma, ids = table.column("sigma"), table.column("id")
    ids = None if ids is None else ids.astype(np.int64)
    whole = View(Path(table.path).name, xyz, uv, sigma, ids)
    if table.view_index is None:
        return [whole]
    index = table.view_index
    if (np.diff(index) < 0).any():  # the rows of a view are scattered
        order = np.argsort(index, kind="stable")
        whole, index = whole.take(order), index[order]
    ends = np.searchsorted(index, np.arange(1, len(table.view_names)))
    bounds = [0, *ends.tolist(), n]
    return [
        replace(whole.take(slice(a, b)), id=name)  # type: ignore[arg-type]  # a slice selects rows, too
        for name, a, b in zip(table.view_names, bounds, bounds[1:], strict=False)
    ]
