"""Grid points numbered in another order: 9x6 read as 6x9, by columns instead of by rows.

A plane is seen through a homography, and a lens bends that by less than the points' spacing. Where it leaves more in
most views, the points are not where the table says; the numberings of a grid of as many points are tried in their
place.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from camcal.data.observations import Observations, View
from camcal.errors import DataError
from camcal.geometry import homography
from camcal.geometry.neighbours import spacing
from camcal.geometry.numbers import distinct

Array = np.ndarray

#: A homography that leaves more than this part of the points' spacing (median) maps them to others: a lens of 150
#: degrees leaves .3 in the worst of 54 real views; 54 points in another order leave 3.
ASTRAY = 0.5
#: ... and a numbering is the right one where it leaves less than this part of that.
MENDED = 0.2
#: Steps from point to point change by less than this part of the shortest from one to the next: of 9 points, the last
#: 1.5 times as far away as the first, by .23; where a row wraps round, by 3 and more. Other grids take the longer way.
EVEN = 0.5
#: views that are looked at; all of a table are numbered alike
LOOKED_AT = 5
#: points of a grid that can be numbered in two ways with rows and columns: 2 x 3
LEAST_GRID = 6
#: decimals, of the board's extent, in which coordinates of one row agree: tables are written with six or more
DIGITS = 6


def check_numbering(data: Observations) -> None:
    """Raise a DataError if in every view the points fit another numbering of the grid and not this one."""
    whole, left = [], []
    for view in data.views:
        size = _grid(view)
        if size is None:
            continue
        if _even(view, *size):  # as a rule the first view
            return
        whole.append(view)
        left.append(_left(view, view.xyz[:, :2]))
        if left[-1] <= ASTRAY:
            return
        if len(whole) == LOOKED_AT:
            break
    if not whole or 2 * len(whole) < min(len(data.views), LOOKED_AT):
        return
    columns, rows = _grid(whole[0]) or (0, 0)
    for words, order in _numberings(columns * rows):
        if all(_left(v, order) < MENDED * before for v, before in zip(whole, left, strict=True)):
            own = f"{columns}x{rows}" + (", column by column" if words == f"{columns}x{rows}" else "")
            raise DataError(
                f"the points are numbered as a grid of {own}, but their positions in the pictures are "
                f"those of {words}, row by row.",
                "Give the board's size as columns x rows of inner corners, and number its points row by row.",
            )


def _grid(view: View) -> tuple[int, int] | None:
    """Columns and rows of a view that holds all points of a grid in the plane z = 0, row by row; otherwise None."""
    if len(view) < LEAST_GRID or np.ptp(view.xyz[:, 2]) > 0:
        return None
    size = float(np.abs(view.xyz).max())
    x, y = (distinct(np.round(view.xyz[:, i] / size, DIGITS)) for i in (0, 1))
    return (len(x), len(y)) if len(x) * len(y) == len(view) and min(len(x), len(y)) > 1 else None


def _even(view: View, columns: int, rows: int) -> bool:
    """Return whether points and image points are both a grid row by row, whose steps hardly change along rows and
    columns.

    In a wrong numbering some row wraps round: a step back by several points. To ask costs a tenth of a homography.
    """
    for at in (view.xyz[:, :2], view.uv):
        grid = at.reshape(rows, columns, 2)
        for line in (grid, grid.swapaxes(0, 1)):
            steps = line[1:] - line[:-1]
            changes = steps[1:] - steps[:-1]
            most = np.square(changes).sum(-1).max(initial=0.0)
            if not most < EVEN**2 * np.square(steps).sum(-1).min():
                return False
    return True


def _numberings(count: int) -> Iterator[tuple[str, Array]]:
    """Every other grid with the same number of points, with their coordinates (N, 2)."""
    for columns in range(2, count // 2 + 1):
        if count % columns == 0:
            rows = count // columns
            x, y = np.meshgrid(np.arange(columns), np.arange(rows))
            # column by column is the mirror image of another one of these, and a homography maps that as well
            yield f"{columns}x{rows}", np.c_[x.ravel(), y.ravel()].astype(float)


def _left(view: View, plane: Array) -> float:
    """The median distance of a view's points from a homography of points (N, 2), relative to their spacing."""
    h = homography.homographies(plane[None], view.uv[None], steps=0)[0]  # half a spacing is a coarse question
    seen = np.c_[plane, np.ones(len(plane))] @ h.T
    with np.errstate(all="ignore"):
        off = np.linalg.norm(seen[:, :2] / seen[:, 2:] - view.uv, axis=1)
    return float(np.median(off) / max(spacing(view.uv), 1e-12))
