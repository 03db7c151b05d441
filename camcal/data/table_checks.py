"""Checks of a table of numbers as a whole: duplicate points, exchanged pixels and board coordinates."""

from __future__ import annotations

import numpy as np

from camcal.data.columns import shown
from camcal.data.table import Table
from camcal.errors import DataError
from camcal.geometry import dlt

Array = np.ndarray
FEWEST_FOR_GRID = 9  #: below 3 x 3 points a grid can be chance
FULL_GRID = 1.5  #: cells of the grid per point: a board with a third of its points hidden still counts
#: points for which a projection matrix leaves residuals that mean something, and more than which take long
FEWEST_FOR_DLT, MOST_FOR_DLT = 8, 5000
#: A projection matrix leaves .003 to .03 of the scatter of the image points of a rig, hand-clicked ones included; of
#: columns that are no points and images 1 and more. The other order has to leave a tenth.
NO_CAMERA, FITS = 0.1, 0.1
PIXELS_SPAN = 20.0  #: a board fills more of a picture than this, px


def check_duplicates(table: Table) -> None:
    """Reject a point that one view has twice.

    With ids the same id is the same point; without, the same X, Y, Z.

    Raises
    ------
    DataError
    """
    rows = _repeated(_keys(table))
    if rows is None:
        return
    first, again = rows
    view = (
        "" if table.view_index is None else f" in view '{shown(table.view_names[table.view_index[again]])}'"
    )
    ids = table.column("id")
    where = f"{table.where(again)}: "
    if ids is not None:
        raise DataError(
            f"{where}id {ids[again]:.0f} is given a second time{view}, after {table.row_name(first)}.",
            "A point has one id, and each view has it once.",
        )
    xyz = ", ".join(f"{a + 0.0:g}" for a in (_column_or_zero(table, c)[again] for c in "XYZ"))
    same = np.array_equal(table.values[first], table.values[again])
    raise DataError(
        f"{where}the point ({xyz}) is given a second time{view}, after {table.row_name(first)}, "
        f"{'with the same' if same else 'with another'} image point.",
        "Remove one of the rows."
        if same
        else "Average the two, or give their views different names; points at the same position need ids.",
    )


def check_not_swapped(table: Table) -> None:
    """Reject a table whose u, v are board coordinates and whose X, Y are pixels.

    A board's points stand on a grid of few different coordinates; measured pixels hardly ever share one.
    Pixels on an exact grid do exist (a projector's pattern), so a header is believed unless the grid starts
    at (0, 0), a board's corner, and X, Y have the signs and the span of pixels; or unless the first two views
    have exactly the same u, v at different X, Y, which no camera sees and every board has.

    Raises
    ------
    DataError
    """
    if _repeats(table, "uv") and not _repeats(table, "XY"):
        raise DataError(
            f"{table.where(0)}: u and v are identical in two views, as board points are, and X and Y "
            f"differ, as image points do; X,Y,Z must be the points of the board and u,v those of the image.",
            _exchange(table),
        )
    if not table.header and _pixels_first(table):
        raise DataError(
            f"{table.where(0)}: no camera fits the columns as X Y Z u v, but one does fit them as u v X Y Z.",
            "Name the columns in a first row: u,v,X,Y,Z.",
        )
    rows = slice(None) if table.view_index is None else table.view_index == 0
    x, y, z, u, v = (_column_or_zero(table, c)[rows] for c in ("X", "Y", "Z", "u", "v"))
    if len(x) < FEWEST_FOR_GRID or not _is_scatter(x, y):
        return
    swapped = not z.any() and _is_grid(u, v)
    rotated = not v.any() and _is_grid(z, u)  # u v X Y Z read as X Y Z u v
    if table.header:
        span = min(np.ptp(x), np.ptp(y))
        swapped = swapped and u.min() == v.min() == 0 and min(x.min(), y.min()) >= 0 and span > PIXELS_SPAN
        rotated = False
    if not (swapped or rotated):
        return
    found = "u and v are a regular grid" if swapped else "Z and u are a regular grid and v is 0"
    raise DataError(
        f"{table.where(0)}: {found}, like a board, and X and Y are scattered, like image points; X,Y,Z "
        f"must be the points of the board and u,v those of the image.",
        _exchange(table),
    )


def _pixels_first(table: Table) -> bool:
    """Return whether five columns without a header are u v X Y Z of points in space."""
    if table.view_index is not None or table.columns != ("X", "Y", "Z", "u", "v"):
        return False
    values = table.values
    if not FEWEST_FOR_DLT <= len(values) <= MOST_FOR_DLT or min(np.ptp(values, axis=0)) == 0:
        return False
    given, other = (
        _misfit(values[:, a], values[:, b]) for a, b in (([0, 1, 2], [3, 4]), ([2, 3, 4], [0, 1]))
    )
    return given > NO_CAMERA and other < FITS * given


def _misfit(xyz: Array, uv: Array) -> float:
    """The residual scatter of image points about a projection matrix, as a fraction of their scatter."""
    matrix = dlt.projection_matrices(xyz[None], uv[None])[0]
    seen = np.c_[xyz, np.ones(len(xyz))] @ matrix.T
    with np.errstate(all="ignore"):
        off = np.square(seen[:, :2] / seen[:, 2:] - uv).sum(1).mean()
    return float(np.sqrt(off / np.square(uv - uv.mean(0)).sum(1).mean()))


def _exchange(table: Table) -> str:
    if table.header:
        return "Exchange the names in the header."
    return "Name the columns in a first row: view,X,Y,Z,u,v."


def _repeats(table: Table, names: str) -> bool:
    """Return whether the first two views have the same set of values in these columns."""
    if table.view_index is None:
        return False
    columns = np.stack([_column_or_zero(table, c) for c in names], 1)
    one, other = (columns[table.view_index == i] for i in (0, 1))
    if not (len(one) and len(other) and np.array_equal(one.min(0), other.min(0))):
        return False  # as nearly always; sorting takes ten times as long
    first, second = (np.unique(rows, axis=0) for rows in (one, other))
    return len(first) >= FEWEST_FOR_GRID and np.array_equal(first, second)


def _column_or_zero(table: Table, name: str) -> Array:
    column = table.column(name)
    return np.zeros(len(table.values)) if column is None else column


def _is_grid(a: Array, b: Array) -> bool:
    columns, rows = len(np.unique(a)), len(np.unique(b))
    return min(columns, rows) > 1 and columns * rows <= FULL_GRID * len(a)


def _is_scatter(a: Array, b: Array) -> bool:
    return min(len(np.unique(a)), len(np.unique(b))) > len(a) / 2


def _keys(table: Table) -> list[Array]:
    """The values that must differ between the rows of a table."""
    ids = table.column("id")
    keys = [ids] if ids is not None else [_column_or_zero(table, c) for c in "XYZ"]
    keys = [(k + 0.0).view(np.uint64) for k in keys]  # + 0.0 makes -0.0 the same as 0.0
    if table.view_index is not None:
        keys.append(table.view_index.astype(np.uint64))
    return keys


def _repeated(keys: list[Array]) -> tuple[int, int] | None:
    """The first row that repeats an earlier one, as (earlier, repeating), or None.

    Rows are compared by a 64-bit hash; only rows of equal hash are looked at themselves.
    """
    mixed = np.zeros(len(keys[0]), np.uint64)
    for key in keys:
        mixed = (mixed + key) * np.uint64(0x9E3779B97F4A7C15)  # 2^64 / golden ratio: spreads all bits upward
        mixed ^= mixed >> np.uint64(32)  # and down again
    ordered = np.sort(mixed)
    twice = ordered[1:][ordered[1:] == ordered[:-1]]
    if not len(twice):
        return None
    seen: dict[tuple[int, ...], int] = {}
    for row in np.flatnonzero(np.isin(mixed, twice)).tolist():
        whole = tuple(int(k[row]) for k in keys)
        if whole in seen:
            return seen[whole], row
        seen[whole] = row
    return None
