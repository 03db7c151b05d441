"""Plots of a table: parameters with bands, the matrix with its reference, innovations, gain.

Needs matplotlib (the extra `report`).
"""

from __future__ import annotations

import csv
import importlib.util
import io
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from camcal.errors import DataError, UsageError
from camcal.system.writing import atomic_write
from camcal.track.table import MATRIX, PARAMETERS

Array = np.ndarray

#: rows that are drawn at most; of a longer table every second, fourth, ... row, alarms always
MOST = 4000
ENDS = 1  #: per cent of the values at each end that may lie outside of a panel
LINES = 50  #: alarms that get a line in a panel, the first ones: more of them hide the curves
#: Okabe and Ito's colours, which remain distinct for colour-blind readers
BLUE, ORANGE, RED = "#0072B2", "#E69F00", "#D55E00"

PANELS = {
    "fx, fy (px)": ("fx", "fy"),
    "cx, cy (px)": ("cx", "cy"),
    "skew (px)": ("skew",),
    "rotation vector (rad)": ("rx", "ry", "rz"),
    "translation": ("tx", "ty", "tz"),
}


def require_matplotlib() -> None:
    """Raise a UsageError if matplotlib is not installed."""
    if importlib.util.find_spec("matplotlib") is None:
        raise UsageError("plots need matplotlib, which is not installed.", "pip install 'camcal[report]'")


def read_table(path: Path) -> dict[str, Array]:
    """The numeric columns of a table of `camcal track`, thinned to at most 2 * `MOST` rows.

    Raises
    ------
    DataError
        If the file is no such table.
    """
    kept: list[dict[str, Any]] = []
    alarms: list[dict[str, Any]] = []
    stride = 1
    for index, row in enumerate(_rows(path)):
        if index % stride == 0:
            kept.append(row)
        elif str(row.get("changed")) == "1" and len(alarms) < MOST:
            alarms.append(row)
        if len(kept) > MOST:
            kept, stride = kept[::2], 2 * stride
    if not kept or "frame" not in kept[0] or "m11" not in kept[0]:
        raise DataError(f"{path}: not a table of `camcal track`.", "Give the file that -o wrote.")
    rows = sorted(kept + alarms, key=lambda row: int(row["frame"]))
    names = [n for n in rows[0] if n != "status"]
    return {n: np.array([float(r[n]) if r[n] not in ("", None) else np.nan for r in rows]) for n in names}


def _rows(path: Path) -> Iterator[dict[str, Any]]:
    with path.open(encoding="utf-8", newline="") as stream:
        first = stream.read(1)
        stream.seek(0)
        if first == "{":
            yield from (json.loads(line) for line in stream)
        else:
            yield from csv.DictReader(stream)


def paths(folder: Path) -> list[Path]:
    """The files that `draw` writes."""
    return [folder / f"{name}.svg" for name in ("parameters", "innovation", "gain", "matrix")]


def draw(table: Path, folder: Path, reference: Array | None = None, force: bool = False) -> list[Path]:
    """Draw all plots of a table into a folder, as SVG.

    Parameters
    ----------
    table : Path
        What `camcal track -o` wrote.
    reference : (3, 4) array, optional
        The projection matrix to compare with; without it that of the last frame.

    Returns
    -------
    list of Path
    """
    require_matplotlib()
    columns = read_table(table)
    folder.mkdir(parents=True, exist_ok=True)
    figures = [parameters(columns), innovations(columns), gains(columns), matrix(columns, reference)]
    for path, figure in zip(paths(folder), figures, strict=True):
        stream = io.BytesIO()
        figure.savefig(stream, format="svg")
        atomic_write(path, stream.getvalue(), force)
    return paths(folder)


def _panels(count: int) -> tuple[Any, Any]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 1.9 * count + 0.4), layout="constrained")
    axes = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
    axes[-1].set_xlabel("frame")
    return figure, axes


def _mark(axis: Any, columns: dict[str, Array]) -> None:
    for frame in columns["frame"][columns["changed"] == 1][:LINES]:
        axis.axvline(frame, color=RED, lw=0.8, ls="--")


def parameters(columns: dict[str, Array]) -> Any:
    """K, R, t and distortion over time, each with a band of two sigmas."""
    panels = {title: [n for n in names if np.nanmax(columns[n]) != 0] for title, names in PANELS.items()}
    known = {*MATRIX, *PARAMETERS}
    bent = [n.removeprefix("sigma_") for n in columns if n.startswith("sigma_")]
    panels["distortion"] = [n for n in bent if n not in known]
    panels = {title: names for title, names in panels.items() if names}
    figure, axes = _panels(len(panels))
    for axis, (title, names) in zip(axes, panels.items(), strict=True):
        for name, colour in zip(names, (BLUE, ORANGE, "#009E73", "#CC79A7", "#56B4E9") * 3, strict=False):
            value, spread = columns[name], 2 * columns[f"sigma_{name}"]
            # each about its own median: the sizes differ, the changes are what one looks for
            middle = float(np.nanmedian(value))
            axis.fill_between(
                columns["frame"],
                value - spread - middle,
                value + spread - middle,
                color=colour,
                alpha=0.2,
                lw=0,
            )
            axis.plot(columns["frame"], value - middle, color=colour, lw=1, label=_less(name, middle))
        axis.set_ylabel(title)
        axis.legend(loc="upper left", fontsize=7, ncols=3)
        _limit(axis, columns, names)
        _mark(axis, columns)
    figure.suptitle("Parameters minus their medians, with bands of two sigmas; alarms dashed", fontsize=9)
    return figure


def _less(name: str, middle: float) -> str:
    """The label of a curve drawn relative to a value: `fx - 900.1`."""
    return f"{name} {'-' if middle >= 0 else '+'} {abs(middle):.6g}"


def _limit(axis: Any, columns: dict[str, Array], names: list[str]) -> None:
    """Axis limits that ignore the wide bands of the first frames."""
    low, high = [], []
    for name in names:
        middle = np.nanmedian(columns[name])
        value, spread = columns[name] - middle, columns[f"sigma_{name}"]
        usual = 3 * np.nanmedian(spread)
        low.append(np.nanpercentile(value, ENDS) - usual)
        high.append(np.nanpercentile(value, 100 - ENDS) + usual)
    if np.isfinite([*low, *high]).all() and max(high) > min(low):
        axis.set_ylim(min(low), max(high))


def innovations(columns: dict[str, Array]) -> Any:
    """The distances of the points from their predictions, and the statistics of the change tests."""
    figure, axes = _panels(3)
    names = ("innovation", "score", "cusum")
    labels = ("innovation (px)", "score (sigmas)", "cumulative sum")
    for axis, name, label in zip(axes, names, labels, strict=True):
        axis.plot(columns["frame"], columns[name], color=BLUE, lw=0.8)
        axis.set_ylabel(label)
        _mark(axis, columns)
    return figure


def gains(columns: dict[str, Array]) -> Any:
    """The gain, and the number of frames that the estimate is equivalent to."""
    figure, axes = _panels(2)
    for axis, name, label in zip(axes, ("gain", "effective"), ("gain", "effective frames"), strict=True):
        axis.semilogy(columns["frame"], columns[name], color=BLUE, lw=1)
        axis.set_ylabel(label)
        _mark(axis, columns)
    return figure


def matrix(columns: dict[str, Array], reference: Array | None = None) -> Any:
    """The projection matrix with its reference, as in Barranco & Medel's figure 2, and over time.

    Left: the entries at the last frame. Right: the distance of each frame's matrix from the reference,
    relative, with what its own covariance expects.
    """
    from matplotlib.figure import Figure

    values = np.stack([columns[n] for n in MATRIX], 1)
    known = np.isfinite(values).all(1)
    last = values[known][-1] if known.any() else np.full(12, np.nan)
    wanted = last if reference is None else np.asarray(reference, float).reshape(12) / reference[2, 3]
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    place = np.arange(12)
    left.bar(place - 0.2, np.abs(wanted), 0.4, color=ORANGE, label="reference")
    left.bar(place + 0.2, np.abs(last), 0.4, color=BLUE, label="estimate, last frame")
    left.set_yscale("log")
    left.set_xticks(place, MATRIX, rotation=60, fontsize=7)
    left.set_ylabel("|entry|, m34 = 1")
    left.margins(y=0.15)
    left.legend(fontsize=7, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    size = np.linalg.norm(wanted)
    spread = np.sqrt(sum(columns[f"sigma_{n}"] ** 2 for n in MATRIX))
    right.semilogy(
        columns["frame"], np.linalg.norm(values - wanted, axis=1) / size, color=BLUE, lw=1, label="distance"
    )
    right.semilogy(columns["frame"], spread / size, color="black", lw=1, ls=":", label="expected (1 sigma)")
    right.set_xlabel("frame")
    right.set_ylabel("|M - reference| / |reference|")
    right.legend(fontsize=7, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    _mark(right, columns)
    return figure
