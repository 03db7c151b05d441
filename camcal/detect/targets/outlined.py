"""Targets of separate dark squares, plain or with markers: their corners are intersections of fitted edges."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from camcal.detect.board_points import LOCAL_POINTS, from_points
from camcal.detect.outlines import Squares, refine_squares
from camcal.detect.pyramid import grey_span
from camcal.detect.targets.base import Detection

Array = np.ndarray

STRAY = 0.1  #: of a side; a corner farther from where its neighbours put it is not of this target


def fit_squares(gray: Array, starts: Array, room: float) -> tuple[Squares, Array]:
    """The squares (K, 4, 2) that start clockwise at these corners, and their shortest sides (K,), px.

    `room` is the distance from an edge to the next one, inside or outside, of a side.
    """
    lengths = np.linalg.norm(np.roll(starts, -1, 1) - starts, axis=2)
    along, up = starts[:, 1] - starts[:, 0], starts[:, 3] - starts[:, 0]
    area = np.abs(along[:, 0] * up[:, 1] - along[:, 1] * up[:, 0])
    # across a foreshortened square it is less far than along its sides
    across = area / lengths.max(1)
    return refine_squares(gray, starts, across * min(1.0, room)), lengths.min(1)


def in_place(points: Array, side: float, squares: Array, fitted: Squares) -> Array:
    """A mask (K,) of the squares whose corners are where those of their neighbours predict them.

    Parameters
    ----------
    points : (4 S, 3) array
        The target's; square k has points 4 k to 4 k + 3.
    side : float
        Of a square.
    squares : (K,) int array
        Which ones were fitted.
    fitted : Squares
        Corners in the order of the points.
    """
    keep = fitted.good.copy()
    rows = np.flatnonzero(keep)
    known = points[(4 * squares[rows, None] + np.arange(4)).ravel(), :2]
    if len(known) <= LOCAL_POINTS:
        return keep
    seen = fitted.corners[rows].reshape(-1, 2)
    uv, jacobian, certain = from_points(known, known, seen, leave_out=True)
    room = np.maximum(STRAY * side * np.linalg.norm(jacobian, axis=1).min(1), 1.0)
    stray = certain & (np.linalg.norm(uv - seen, axis=1) > room)
    keep[rows[stray.reshape(-1, 4).any(1)]] = False
    return keep


def detection(
    gray: Array,
    count: int,
    squares: Array,
    fitted: Squares,
    keep: Array,
    sides: Array,
    info: Mapping[str, Any] | None = None,
) -> Detection:
    """The corners of the squares that are kept, out of `count` squares; `sides` (K,) are in px."""
    rows = np.flatnonzero(keep)[np.argsort(squares[keep])]
    ids = (4 * squares[rows, None] + np.arange(4)).ravel()
    missing = np.setdiff1d(np.arange(4 * count), ids)
    covariance = fitted.covariance[rows].reshape(-1, 2, 2)
    said: dict[str, Any] = {
        **(info or {}),
        "rejected": {int(i): "not seen, or not where its neighbours predict" for i in missing},
        "square_px": float(np.median(sides[rows])),
        "blur_px": float(np.median(fitted.blur[rows])),
        "contrast": float(np.median(fitted.contrast[rows]) * 255 / grey_span(gray)),
        "covariance": covariance,
    }
    sigma = np.sqrt(0.5 * np.trace(covariance, axis1=1, axis2=2))
    return Detection(ids, fitted.corners[rows].reshape(-1, 2), sigma, said)
