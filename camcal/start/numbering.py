"""Grid points numbered in another order: 9x6 read as 6x9, by columns instead of by rows.

A plane is imaged by a homography, from which a lens deviates by less than the points' spacing. If the deviation is
larger in most views, the points are assigned wrongly, and other numberings of a grid with as many points are tried.
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

#: Median residual of a homography, relative to the points' spacing, above which the numbering is wrong: a lens of 150
#: degrees leaves .3 in the worst of 54 real views; 54 points in another order leave 3.
ASTRAY = 0.5
#: ... and another numbering is correct if its residual is below this fraction of that.
MENDED = 0.2
#: Largest change between consecutive steps, relative to the shortest, in a correct row: .23 for 9 points of which the
#: last is 1.5 times as far away as the first; 3 or more if a row wraps around. Other grids are tested by homographies.
EVEN = 0.5
#: views that are tested; all views of a table are numbered alike
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
    """Return whether points and image points both form a grid row by row, whose steps hardly change along rows and
    columns.

    In a wrong numbering some row wraps around, with a step back by several points. The test costs a tenth of a
    homography.
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
            # column by column is a mirror image of another one of these, to which homographies are insensitive
            yield f"{columns}x{rows}", np.c_[x.ravel(), y.ravel()].astype(float)


def _left(view: View, plane: Array) -> float:
    """The median distance of a view's points from a homography of points (N, 2), relative to their spacing."""
    h = homography.homographies(plane[None], view.uv[None], steps=0)[0]  # half a spacing needs no refinement
    seen = np.c_[plane, np.ones(len(plane))] @ h.T
    with np.errstate(all="ignore"):
        off = np.linalg.norm(seen[:, :2] / seen[:, 2:] - view.uv, axis=1)
    return float(np.median(off) / max(spacing(view.uv), 1e-12))
