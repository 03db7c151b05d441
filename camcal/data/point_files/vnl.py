"""Corners of mrcal and mrgingham: lines `filename x y [level]` below a legend `# filename x y level`.

Corners stand row by row; a corner that was not found has `-` in its place. `boardX` and `boardY`, where the
legend has them, are the point on the board. Levels are not used.
"""

from __future__ import annotations

import numpy as np

from camcal.data.formats.source import Source
from camcal.data.point_files.base import Array, Board, Reader, Size, table_of
from camcal.data.table import Table
from camcal.errors import DataError

MISSING = "-"


def _sniff(source: Source) -> bool:
    return source.suffix == ".vnl"


def _rows(source: Source) -> tuple[list[str], list[list[str]]]:
    """The legend and the fields of each row; `##` begins a comment."""
    legend: list[str] = []
    rows: list[list[str]] = []
    for number, line in enumerate((source.text or "").splitlines(), 1):
        words = line.split()
        if not words or words[0].startswith(("##", "#!")):
            continue
        if words[0].startswith("#"):
            legend = legend or [w for w in [words[0][1:], *words[1:]] if w]
            continue
        if len(words) < 3:
            raise DataError(
                f"{source.path}:{number}: {len(words)} fields; filename x y are needed.", "Is it complete?"
            )
        rows.append(words)
    if not rows:
        raise DataError(f"{source.path}: it has no rows of points.", "Is it the right file?")
    return legend or ["filename", "x", "y", "level"], rows


def _read(source: Source, board: Board) -> tuple[Table, Size | None]:
    legend, rows = _rows(source)
    at = {name: legend.index(name) for name in ("filename", "x", "y") if name in legend}
    if len(at) < 3:
        raise DataError(f"{source.path}: the legend lacks filename, x or y.", "Is it a .vnl of corners?")
    views: dict[str, list[list[str]]] = {}
    for words in rows:
        views.setdefault(words[at["filename"]], []).append(words)
    placed = [legend.index(n) for n in ("boardX", "boardY")] if {"boardX", "boardY"} <= set(legend) else None
    made = []
    for name, own in views.items():
        pixels = _numbers(source, own, (at["x"], at["y"]))
        seen = np.isfinite(pixels).all(1)
        if not seen.any():
            continue
        if placed is None:
            xyz = board.points(len(own), str(source.path))
        else:
            xyz = np.c_[_numbers(source, own, placed), np.zeros(len(own))]
        made.append((name, xyz[seen], pixels[seen], None if placed else np.flatnonzero(seen)))
    return table_of(source, made), None


def _numbers(source: Source, rows: list[list[str]], columns: tuple[int, ...] | list[int]) -> Array:
    """Columns of the rows (N, C), NaN for `-`."""

    def number(words: list[str], column: int) -> float:
        text = words[column] if column < len(words) else MISSING
        return float("nan") if text == MISSING else float(text)

    try:
        return np.array([[number(w, c) for c in columns] for w in rows])
    except ValueError as error:
        raise DataError(f"{source.path}: {error}.", "Correct or remove that row.") from None


READER = Reader("mrcal's corners", _sniff, _read)
