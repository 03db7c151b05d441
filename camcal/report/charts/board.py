"""The chart of the board's shape, if that was estimated."""

from __future__ import annotations

import numpy as np

from camcal.plan.solution import Solution
from camcal.report.charts.base import Arrows, Cells, Chart, Layer, Points
from camcal.report.charts.residuals import enlargement
from camcal.solve.calibration import ShapedBoard

Array = np.ndarray


def shape(solution: Solution) -> Chart | None:
    """Height of each point above the ideal board as a map, and its offsets in the plane as arrows."""
    board = solution.board
    if not isinstance(board, ShapedBoard) or board.label is not None:
        return None  # several boards have no common plane
    target = solution.observations.target or {}
    square = float(target.get("square") or 1.0)
    ideal, offset = board.ideal / square, (board.points - board.ideal) / square
    size = float(np.ptp(ideal[:, :2], axis=0).max())
    pad = 0.08 * size
    scale = enlargement(np.linalg.norm(offset[:, :2], axis=1), size)
    x = float(ideal[:, 0].min()) - pad, float(ideal[:, 0].max()) + pad
    y = float(ideal[:, 1].min()) - pad, float(ideal[:, 1].max()) + pad
    layers: list[Layer] = []
    grid = _gridded(ideal, 1e3 * offset[:, 2])
    if grid is not None:
        layers.append(Cells(*grid, unit="z, 1/1000", centred=True))
    layers += [
        Points(ideal[:, :2], tone="faint", radius=2),
        Arrows(ideal[:, :2], scale * offset[:, :2], tone="text", label="offset in the plane"),
    ]
    words = (target.get("shape") or {}).get("words", "")
    return Chart(
        "Shape of the board",
        f"Colours: height over the plane in thousandths of {'a square' if target else 'the unit'}; arrows: "
        f"offsets in the plane, {scale:g} times enlarged." + (f" In words: {words}." if words else ""),
        "x, squares" if target else "x",
        "y, squares" if target else "y",
        x,
        y,
        tuple(layers),
        picture=True,
    )


def _gridded(ideal: Array, values: Array) -> tuple[Array, Array, Array] | None:
    """Columns, rows and values (R, C) of points that fill most of a grid; None for others."""
    columns, c = np.unique(ideal[:, 0].round(6), return_inverse=True)
    rows, r = np.unique(ideal[:, 1].round(6), return_inverse=True)
    if len(columns) * len(rows) > 2 * len(ideal):
        return None
    filled = np.full((len(rows), len(columns)), np.nan)
    filled[r, c] = values
    return columns, rows, filled
