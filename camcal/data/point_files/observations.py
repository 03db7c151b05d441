"""Observations inside calibration files: OpenCV's sample (`image_points`) and PhotonVision's JSON."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from camcal.data.formats.base import floats, image_size
from camcal.data.formats.opencv import _array, _entries, _size
from camcal.data.formats.source import Source
from camcal.data.point_files.base import Board, Reader, Size, table_of
from camcal.data.table import Table
from camcal.errors import DataError


def _sniff_opencv(source: Source) -> bool:
    return source.kind in ("yaml", "xml", "json") and "imagepoints" in _entries(source)


def _read_opencv(source: Source, board: Board) -> tuple[Table, Size | None]:
    """`image_points`, one row per picture; the board from `grid_points`, or from its size and square."""
    found = _entries(source)
    entry = found["imagepoints"]
    if not isinstance(entry, Mapping) or "rows" not in entry:
        raise DataError(
            f"{source.path}: image_points is not a matrix with a row for each picture.", "Is it damaged?"
        )
    views = int(entry["rows"])
    pixels = floats(_array(entry)).reshape(views, -1, 2)
    if "gridpoints" in found:
        xyz = floats(_array(found["gridpoints"]), 3 * pixels.shape[1], "grid_points").reshape(-1, 3)
    else:
        own = board
        if board.grid is None and "boardwidth" in found:
            grid = int(found["boardwidth"]), int(found["boardheight"])
            own = Board(grid, float(found.get("squaresize", 1.0)))
        xyz = own.points(pixels.shape[1], str(source.path))
    ids = np.arange(len(xyz))
    made = [(f"view{i + 1}", xyz, uv, ids) for i, uv in enumerate(pixels)]
    return table_of(source, made), _size(found)


def _sniff_photonvision(source: Source) -> bool:
    found = source.mapping.get("observations") if source.kind == "json" else None
    return isinstance(found, list) and any(
        isinstance(o, Mapping) and "locationInImageSpace" in o for o in found
    )


def _read_photonvision(source: Source, board: Board) -> tuple[Table, Size | None]:
    """Each observation has its points in space and in the picture, and a flag whether they were used."""
    found = source.mapping
    made = []
    for i, view in enumerate(found["observations"]):
        xyz = _points(view["locationInObjectSpace"], "xyz")
        uv = _points(view["locationInImageSpace"], "xy")
        used = np.asarray(view.get("cornersUsed", [True] * len(uv)), bool) & (uv > -1).all(1)
        name = str(view.get("snapshotName") or f"view{i + 1}")
        made.append((name, xyz[used], uv[used], np.flatnonzero(used)))
    size = found.get("resolution")
    return table_of(source, made), None if size is None else image_size(size["width"], size["height"])


def _points(entries: Any, names: str) -> np.ndarray:
    return np.array([[float(e[n]) for n in names] for e in entries]).reshape(-1, len(names))


OPENCV = Reader("OpenCV's image_points", _sniff_opencv, _read_opencv)
PHOTONVISION = Reader("PhotonVision's observations", _sniff_photonvision, _read_photonvision)
