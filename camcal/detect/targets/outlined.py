"""Targets of separate dark squares, plain or with markers, whose corners are intersections of fitted edges."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from camcal.detect.board_points import LOCAL_POINTS, strays
from camcal.detect.outlines import Squares, refine_squares
from camcal.detect.pyramid import grey_span
from camcal.detect.targets.base import Detection
from camcal.geometry import homography

Array = np.ndarray

#: degrees of the polynomials that describe distortion in a view; the highest with three corners per term is used
DEGREES = (5, 3)
STRAY = 0.1  #: of a side; a corner farther from where its neighbours predict it is not part of this target


def fit_squares(gray: Array, starts: Array, room: float, board: Array) -> tuple[Squares, Array]:
    """Fit squares with clockwise initial corners (K, 4, 2); return them and their shortest sides (K,), px.

    They are fitted twice: with straight edges, and with the arcs that follow from the corners of all squares.

    `room` is the distance from an edge to the next one, inside or outside, in sides; `board` (K, 4, 2) are the
    corners on the board.
    """
    lengths = np.linalg.norm(np.roll(starts, -1, 1) - starts, axis=2)
    along, up = starts[:, 1] - starts[:, 0], starts[:, 3] - starts[:, 0]
    area = np.abs(along[:, 0] * up[:, 1] - along[:, 1] * up[:, 0])
    # the distance across a foreshortened square is less than along its sides
    across = area / lengths.max(1) * min(1.0, room)
    fitted = refine_squares(gray, starts, across)
    bent = bows(board, fitted)
    if bent.any():
        fitted = refine_squares(
            gray, np.where(fitted.good[:, None, None], fitted.corners, starts), across, bent
        )
    return fitted, lengths.min(1)


def bows(board: Array, fitted: Squares) -> Array:
    """Outward displacements (K, 4) of the middles of the edges, px; zeros if there are too few corners.

    A homography maps lines to lines, and the middle of an edge from A to B to the mean of their images with weights
    w(A) and w(B), the third homogeneous coordinates. The deviation of the corners from a homography, d(X), is modelled
    as a polynomial in the position X on the board; the middle is then displaced from the chord by

        d((A + B) / 2) - (w(A) d(A) + w(B) d(B)) / (w(A) + w(B))

    Parameters
    ----------
    board : (K, 4, 2) array
        Corners on the board, in the order of those fitted.
    fitted : Squares
    """
    known, seen = board[fitted.good].reshape(-1, 2), fitted.corners[fitted.good].reshape(-1, 2)
    degree = next((d for d in DEGREES if 3 * (d + 1) * (d + 2) // 2 <= len(known)), None)
    if degree is None:
        return np.zeros(fitted.good.shape + (4,))
    h = homography.homographies(known[None], seen[None])
    off = seen - homography.transfer(h, known[None])[0]
    weight = (board @ h[0, 2, :2] + h[0, 2, 2])[..., None]
    middle, scale = known.mean(0), np.abs(known - known.mean(0)).max()

    def terms(at: Array) -> Array:
        x, y = np.moveaxis((at - middle) / scale, -1, 0)
        return np.stack([x**i * y**j for i in range(degree + 1) for j in range(degree + 1 - i)], -1)

    factors, *_ = np.linalg.lstsq(terms(known), off, rcond=None)
    after, next_weight = np.roll(board, -1, 1), np.roll(weight, -1, 1)
    ends = (weight * terms(board) + next_weight * terms(after)) / (weight + next_weight)
    away = (terms((board + after) / 2) - ends) @ factors
    sides = np.roll(fitted.corners, -1, 1) - fitted.corners
    outward = np.stack([sides[..., 1], -sides[..., 0]], -1) / np.linalg.norm(sides, axis=-1, keepdims=True)
    return np.where(fitted.good[:, None], (away * outward).sum(-1), 0.0)


def in_place(points: Array, side: float, squares: Array, fitted: Squares) -> Array:
    """Mask (K,) of the squares whose corners are where those of their neighbours predict them.

    Parameters
    ----------
    points : (4 S, 3) array
        Points of the target; square k has points 4 k to 4 k + 3.
    side : float
        Side of a square.
    squares : (K,) int array
        Indices of the fitted ones.
    fitted : Squares
        Corners in the order of the points.
    """
    keep = fitted.good.copy()
    rows = np.flatnonzero(keep)
    known = points[(4 * squares[rows, None] + np.arange(4)).ravel(), :2]
    if len(known) <= LOCAL_POINTS:
        return keep
    seen = fitted.corners[rows].reshape(-1, 2)
    stray = strays(known, seen, STRAY * side)
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
