"""A pair of tables, world points in one and their pixels in the other, row by row."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from camcal.data.columns import POINTS_2D, POINTS_3D, shown
from camcal.data.table import Table, read_table
from camcal.errors import DataError

ROW_HINT = "Row i of one file belongs to row i of the other."


def read_pair(points3d: str, points2d: str) -> tuple[Table, list[Table]]:
    """Read both tables and join their rows.

    Either may name the view or the id of its rows; where both do, they must agree.

    Returns
    -------
    joined : Table
        Its path and line numbers are those of `points2d`.
    parts : list of the two Tables

    Raises
    ------
    DataError
        If a table is bad, their numbers of rows differ, or their views or ids do.
    """
    world, image = read_table(points3d, POINTS_3D), read_table(points2d, POINTS_2D)
    if len(world.values) != len(image.values):
        raise DataError(
            f"{points3d} holds {len(world.values)} points and {points2d} holds {len(image.values)}; "
            "the same number is needed.",
            ROW_HINT,
        )
    _check_same_ids(world, image)
    _check_same_views(world, image)
    keep = [i for i, name in enumerate(world.columns) if not (name == "id" and "id" in image.columns)]
    named = image if image.view_index is not None else world
    joined = replace(
        image,
        columns=tuple(world.columns[i] for i in keep) + image.columns,
        values=np.hstack([world.values[:, keep], image.values]),
        view_names=named.view_names,
        view_index=named.view_index,
        header=True,  # which file is which was said
    )
    return joined, [world, image]


def _check_same_ids(world: Table, image: Table) -> None:
    a, b = world.column("id"), image.column("id")
    if a is None or b is None or np.array_equal(a, b):
        return
    row = int(np.flatnonzero(a != b)[0])
    raise DataError(
        f"{world.where(row)} has id {a[row]:.0f}, {image.where(row)} has id "
        f"{b[row]:.0f}; the same id is needed.",
        ROW_HINT,
    )


def _check_same_views(world: Table, image: Table) -> None:
    a, b = world.view_index, image.view_index
    if a is None or b is None:
        return
    # Names are numbered by first appearance, so equal views have equal numbers.
    same = a == b
    names = min(len(world.view_names), len(image.view_names))
    same &= np.array([*map(str.__eq__, world.view_names[:names], image.view_names[:names]), False])[
        np.minimum(a, names)
    ]
    if same.all():
        return
    row = int(np.flatnonzero(~same)[0])
    raise DataError(
        f"{world.where(row)} has view '{shown(world.view_names[a[row]])}', "
        f"{image.where(row)} has view '{shown(image.view_names[b[row]])}'; the same view is needed.",
        ROW_HINT,
    )
