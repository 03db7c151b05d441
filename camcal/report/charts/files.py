"""Charts as PNG, SVG or PDF, drawn by matplotlib."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from camcal.data.writing import atomic_write, check_writable
from camcal.errors import UsageError
from camcal.plan.solution import Solution
from camcal.report.charts import charts
from camcal.report.charts.base import Arrows, Bars, Cells, Chart, Line, Points, tick_text
from camcal.report.charts.colours import DIVERGING, SEQUENTIAL
from camcal.system.text import printable

#: the light page's colours
TONES = {
    "text": "#1b1f24",
    "accent": "#0b5cad",
    "second": "#b34700",
    "bad": "#b3261e",
    "faint": "#7f8995",
    "hull": "#f0453a",
}
DPI = 130
MOST_NAMES = 30  #: names below bars that can be read at this size


def write_charts(
    solution: Solution, folder: Path, formats: Sequence[str] = ("png",), force: bool = False
) -> list[Path]:
    """Write each chart of a solution to `folder/<name>.<format>`; the folder is created if it is missing.

    Raises
    ------
    UsageError
        If matplotlib is not installed, or a file exists and `force` is false.
    """
    _needs_matplotlib()
    found = charts(solution)
    folder.mkdir(parents=True, exist_ok=True)
    paths = [(chart, folder / f"{name}.{format}") for name, chart in found.items() for format in formats]
    for _, path in paths:
        check_writable(path, force)
    for chart, path in paths:
        write_chart(chart, path, force)
    return [path for _, path in paths]


def _needs_matplotlib() -> None:
    try:
        import matplotlib  # noqa: F401 - only whether it is there
    except ImportError:
        raise UsageError(
            "charts as files need matplotlib, which is not installed.", "Try: pip install 'camcal[report]'"
        ) from None


def write_chart(chart: Chart, path: Path, force: bool = False) -> None:
    """Write one chart; the file name extension selects the format.

    Raises
    ------
    UsageError
        As `write_charts`.
    """
    _needs_matplotlib()
    atomic_write(path, drawn(chart, path.suffix[1:].lower()), force)


def drawn(chart: Chart, format: str) -> bytes:
    """One chart as the bytes of a file, identical each time."""
    import matplotlib

    with matplotlib.rc_context({"svg.hashsalt": "camcal", "font.size": 9, "text.parse_math": False}):
        return _drawn(chart, format)


def _drawn(chart: Chart, format: str) -> bytes:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.6))
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for layer in chart.layers:
        _DRAW[type(layer)](axes, layer)
    axes.set(xlim=chart.x, ylim=chart.y, xlabel=chart.x_label, ylabel=chart.y_label, title=chart.title)
    if chart.picture:
        axes.set_aspect("equal")
        axes.invert_yaxis()
    bars = chart.named_bars
    if bars is not None:
        few = len(bars.names) <= MOST_NAMES
        axes.set_xticks(np.arange(len(bars.names)) if few else [])
        axes.set_xticklabels([printable(n) for n in bars.names] if few else [], rotation=60, ha="right")
    if any(getattr(layer, "label", "") for layer in chart.layers):
        axes.legend(loc="best", fontsize=8)
    buffer = io.BytesIO()
    metadata = {"Date": None} if format == "svg" else {"CreationDate": None} if format == "pdf" else {}
    figure.savefig(buffer, format=format, dpi=DPI, metadata=metadata, bbox_inches="tight")
    return buffer.getvalue()


def _line(axes: Any, layer: Line) -> None:
    xy = np.r_[layer.xy, layer.xy[:1]] if layer.closed else layer.xy
    colour = TONES[layer.tone]
    if layer.filled:
        axes.fill(xy[:, 0], xy[:, 1], color=colour, alpha=0.16, lw=0, label=layer.label or None)
    else:
        width = 2.8 if layer.heavy else 1.3
        dash = "--" if layer.dashed else "-"
        axes.plot(xy[:, 0], xy[:, 1], dash, color=colour, lw=width, label=layer.label or None)


def _points(axes: Any, layer: Points) -> None:
    axes.plot(
        layer.xy[:, 0],
        layer.xy[:, 1],
        ".",
        ms=1.4 * layer.radius,
        color=TONES[layer.tone],
        label=layer.label or None,
    )


def _arrows(axes: Any, layer: Arrows) -> None:
    axes.quiver(
        layer.xy[:, 0], layer.xy[:, 1], layer.by[:, 0], layer.by[:, 1],
        color=TONES[layer.tone], angles="xy", scale_units="xy", scale=1,
        width=0.0014 if layer.tone == "faint" else 0.003, label=layer.label or None,
    )  # fmt: skip


def _bars(axes: Any, layer: Bars) -> None:
    left, right = layer.sides
    bad = np.zeros(len(layer.heights), bool) if layer.bad is None else layer.bad
    colours = [TONES["bad" if b else layer.tone] for b in bad]
    axes.bar(left, layer.heights, right - left, align="edge", color=colours, label=layer.label or None)


def _cells(axes: Any, layer: Cells) -> None:
    from matplotlib.colors import LinearSegmentedColormap

    name = "diverging" if layer.centred else "sequential"
    colours = LinearSegmentedColormap.from_list(name, DIVERGING if layer.centred else SEQUENTIAL)
    mesh = axes.pcolormesh(
        layer.x, layer.y, layer.part(layer.values), cmap=colours, vmin=0, vmax=1, shading="nearest"
    )
    bar = axes.figure.colorbar(mesh, ax=axes, label=layer.unit)
    bar.set_ticks(layer.part(np.array(layer.marks)), labels=[tick_text(m) for m in layer.marks])


_DRAW: dict[type, Any] = {Line: _line, Points: _points, Arrows: _arrows, Bars: _bars, Cells: _cells}
