"""Output of `camcal compare-optimizers`: a document, the traces as a table, and the convergence plot."""

from __future__ import annotations

import csv
import importlib.util
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from camcal.errors import UsageError
from camcal.solve.optimizers.base import Sample
from camcal.study.compare_optimizers import Run
from camcal.system.writing import atomic_write

SCHEMA = "camcal-optimizers/1"
#: excesses below this are rounding of a cost and are drawn on the axis
FLOOR = 1e-16
LEAST_SECONDS = 1e-4  #: on a logarithmic axis, instead of the 0 of the start


def traces(runs: Sequence[Run]) -> str:
    """All samples of all runs as CSV: name, start, iteration, cost, evaluations, seconds."""
    text = io.StringIO()
    out = csv.writer(text, lineterminator="\n")
    out.writerow(["name", "start", *Sample._fields])
    for run in runs:
        out.writerows([run.name, run.start, *sample] for sample in run.result.samples)
    return text.getvalue()


def trace(samples: Sequence[Sequence[float]]) -> str:
    """The samples of one run as CSV: iteration, cost, evaluations, seconds."""
    text = io.StringIO()
    out = csv.writer(text, lineterminator="\n")
    out.writerow(Sample._fields)
    out.writerows(samples)
    return text.getvalue()


def require_matplotlib() -> None:
    """Raise a UsageError if matplotlib is not installed."""
    if importlib.util.find_spec("matplotlib") is None:
        raise UsageError("a plot needs matplotlib, which is not installed.", "pip install 'camcal[report]'")


def plot(runs: Sequence[Run], path: Path, force: bool = False) -> None:
    """Plot the excess of the cost over the best of all against evaluations and against seconds.

    The format follows the file's name (png, svg, pdf).
    """
    require_matplotlib()
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    lowest = min(run.result.blocks.cost for run in runs)
    figure, axes = pyplot.subplots(1, 2, figsize=(11, 4.5), sharey=True, layout="constrained")
    first = [run for run in runs if run.start == 0]
    colours = pyplot.get_cmap("tab10")
    for index, run in enumerate(first):
        samples = np.array(run.result.samples, float)
        excess = np.maximum(samples[:, 1] / lowest - 1.0, FLOOR) if lowest > 0 else samples[:, 1]
        for axis, column in zip(axes, (2, 3), strict=True):
            style = "-" if run.result.converged else "--"
            axis.loglog(
                np.maximum(samples[:, column], LEAST_SECONDS), excess, style, color=colours(index % 10)
            )
        axes[0].lines[-1].set_label(run.name + ("" if run.result.converged else " (not converged)"))
    axes[0].set(xlabel="evaluations", ylabel="cost / lowest - 1")
    axes[1].set(xlabel="seconds")
    for axis in axes:
        axis.grid(True, alpha=0.3)
    axes[0].legend(fontsize="small")
    try:
        stream = io.BytesIO()
        figure.savefig(stream, format=path.suffix[1:].lower() or "png", dpi=120)
    except ValueError as error:
        raise UsageError(f"cannot draw '{path}': {error}.", "Name the file .png, .svg or .pdf.") from error
    finally:
        pyplot.close(figure)
    atomic_write(path, stream.getvalue(), force)


def document(
    model: str, points: int, views: int, rotation: str, rows: Sequence[dict[str, Any]], command: Sequence[str]
) -> dict[str, Any]:
    """The comparison as one plain document."""
    best = min(rows, key=lambda row: row["cost"])
    return {
        "schema": SCHEMA,
        "command": list(command),
        "model": model,
        "views": views,
        "points": points,
        "rotation": rotation,
        "best": {"name": best["name"], "cost": best["cost"], "rms_point": best["rms_point"]},
        "optimizers": list(rows),
    }
