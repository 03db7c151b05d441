"""Points that were mistaken for others: swapped corners, shifted rows.

A rejected point at the predicted position of another point of its view was mistaken for that one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import numpy as np

from camcal.data.observations import View
from camcal.geometry.neighbours import Neighbours, spacing
from camcal.model.pose import Array
from camcal.records import dataclass
from camcal.solve.calibration import Calibration
from camcal.system.text import listed

#: an observation matches a prediction within this fraction of the distance to the nearest neighbour ...
NEAR = 0.15
#: ... and this many points with the same displacement on the board are a shift, not chance: an outlier
#: anywhere on the board meets a prediction with probability π NEAR² = .07
LEAST_SHIFTED = 3


@dataclass(frozen=True)
class Exchanged:
    """Rejected points of a view that were mistaken for others.

    Attributes
    ----------
    view : str
    swapped : tuple of (row, row)
    shifted : tuple of rows
        Points that lie where others, all displaced alike on the board, are predicted.
    by : (3,) array
        That displacement, in the unit of the points; zeros without any.
    """

    view: str
    swapped: tuple[tuple[int, int], ...]
    shifted: tuple[int, ...]
    by: Array


def exchanged_points(solution: Calibration) -> Iterator[Exchanged]:
    """The views whose rejected points lie where other points are predicted."""
    data = solution.observations
    for view, rows in zip(data.views, data.slices, strict=True):
        residual, used = solution.residuals[rows], data.used[rows]
        wrong = np.flatnonzero(~used & np.isfinite(residual).all(1))
        if len(wrong) < 2:
            continue
        found = in_view(view, view.uv + residual, wrong)
        if found.swapped or found.shifted:
            yield found


def in_view(view: View, predicted: Array, wrong: Array) -> Exchanged:
    """The points for which the rows `wrong` (K,) of a view were mistaken, from the predictions (N, 2), px."""
    known = np.flatnonzero(np.isfinite(predicted).all(1))
    tree = Neighbours(predicted[known])
    apart = spacing(predicted[known])
    distance, index = tree.query(view.uv[wrong])
    taken = {
        int(i): int(known[j])
        for i, j, d in zip(wrong, index, distance, strict=True)
        if d < NEAR * apart and known[j] != i
    }
    swapped = tuple((i, j) for i, j in taken.items() if i < j and taken.get(j) == i)
    alone = {i: j for i, j in taken.items() if taken.get(j) != i}
    size = float(np.ptp(view.xyz, axis=0).max())
    steps = {i: tuple(np.round((view.xyz[j] - view.xyz[i]) / size, 3)) for i, j in alone.items()}
    step, count = Counter(steps.values()).most_common(1)[0] if steps else ((0.0, 0.0, 0.0), 0)
    if count < LEAST_SHIFTED:
        return Exchanged(view.id, swapped, (), np.zeros(3))
    rows = tuple(i for i in alone if steps[i] == step)
    return Exchanged(view.id, swapped, rows, view.xyz[alone[rows[0]]] - view.xyz[rows[0]])


def describe(found: Exchanged, view: View) -> str:
    """Describe exchanged points by their number on the target, otherwise by their row in the view."""

    def name(row: int) -> str:
        return str(int(view.point_ids[row]) if view.point_ids is not None else row)

    said = []
    if found.swapped:
        pairs = listed([f"{name(i)} and {name(j)}" for i, j in found.swapped])
        said.append(f"points {pairs} are swapped")
    if found.shifted:
        rows = listed([name(row) for row in found.shifted], 12)
        by = ", ".join(f"{c:g}" for c in np.round(found.by, 6) + 0.0)
        said.append(f"points {rows} match the points displaced by ({by})")
    return f"view '{found.view}': " + "; ".join(said)
