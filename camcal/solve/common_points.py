"""The points of a target that several views show, by their ids or their coordinates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camcal.data.observations import View
from camcal.geometry.numbers import TINY, distinct_rows
from camcal.model.pose import Array

#: fraction of the largest coordinate within which two points are identical: rounding of printed coordinates
SAME_NUMBER = 1e-9


def common_points(views: Sequence[View]) -> tuple[Array, tuple[Array, ...]] | None:
    """The target's points (M, 3) and the ids of each view's rows; None if views disagree on a point.

    Rows are matched by `point_ids` if all views have them, otherwise by equal coordinates.
    """
    xyz = np.concatenate([v.xyz for v in views])
    if all(v.point_ids is not None for v in views):
        labels = np.concatenate([v.point_ids for v in views])
        _, first, inverse = np.unique(labels, return_index=True, return_inverse=True)
        points = xyz[first]
        if np.abs(points[inverse] - xyz).max(initial=0.0) > SAME_NUMBER * np.abs(xyz).max(initial=1.0):
            return None
    else:
        grid = np.round(xyz / (SAME_NUMBER * max(np.abs(xyz).max(), TINY))).astype(np.int64)
        first, inverse = distinct_rows(grid)
        order = np.argsort(first)  # in the order in which they first appear
        points, inverse = xyz[first[order]], np.argsort(order)[inverse]
    ends = np.cumsum([len(v) for v in views])[:-1]
    return points, tuple(np.split(inverse.reshape(-1), ends))
