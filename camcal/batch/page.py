"""summary.html: the fleet on one self-contained page."""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path

import numpy as np

from camcal.batch.fleet import Control
from camcal.batch.rows import Row
from camcal.batch.summary import DONE, FAILED
from camcal.report import html
from camcal.report.charts.base import Chart, Layer, Line, Points
from camcal.report.charts.svg import svg
from camcal.system.text import counted, listed

#: rows in the table of the page at most; summary.csv has all
MOST_ROWS = 2000
#: dots in a chart at most; outliers are drawn always
MOST_DOTS = 3000

_COLUMNS = (
    ("name", "camera"), ("status", "status"), ("verdict", "verdict"), ("grade", "grade"), ("rank", "rank"),
    ("rms_point", "rms, px"), ("holdout", "held out, px"), ("focal", "focal, px"), ("cx", "cx"), ("cy", "cy"),
    ("distortion", "distortion, px"), ("views", "views"), ("outlier", "outlier"), ("reason", "reason"),
)  # fmt: skip


def counts(rows: Sequence[Row]) -> dict[str, int]:
    """The numbers of jobs: all, finished, failed, with passed gates, with failed gates, and outliers."""
    found = Counter(row["verdict"] if row["status"] == DONE else FAILED for row in rows)
    done = len(rows) - found[FAILED]
    return {
        "job": len(rows),
        "done": done,
        "failed": found[FAILED],
        "passed": found["pass"],
        "gate fallen": done - found["pass"],
        "outlier": sum(bool(row["outlier"]) for row in rows),
    }


def sentence(numbers: Mapping[str, int]) -> str:
    """The numbers of `counts` in words."""
    states = ("done", "failed", "passed")  # the same of one and of many
    said = [f"{n} {what}" if what in states else _plural(n, what) for what, n in numbers.items()]
    return ", ".join(said) + "."


def _plural(n: int, what: str) -> str:
    noun, _, rest = what.partition(" ")
    return f"{counted(n, noun)} {rest}".strip()


def page(rows: Sequence[Row], controls: Sequence[Control]) -> str:
    """The page of a batch.

    Parameters
    ----------
    rows : sequence of Row
        Of `fleet.with_fleet`.
    controls : sequence of Control
    """
    style = Path(html.__file__).with_name("style.css").read_text(encoding="utf-8")
    parts = [
        '<!doctype html><html lang="en"><head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1"><title>camcal batch</title>',
        f"<style>{style}\nmain {{ max-width: 75rem; margin: auto; padding: 1rem }} td {{ white-space: nowrap }}"
        " .charts { display: grid; grid-template-columns: repeat(auto-fill, minmax(22rem, 1fr)); gap: 1rem }"
        " .charts figure { margin: 0 } .scroll { overflow-x: auto }"
        " tr.bad td { color: #b3261e }</style></head><body><main>",
        f"<h1>Batch of {counted(len(rows), 'calibration')}</h1><p>{sentence(counts(rows))}</p>",
        '<div class="charts">',
        *(_figure(control, number) for number, control in enumerate(controls)),
        "</div>",
    ]
    if not controls:
        parts.append("<p>Control charts need eight cameras of one type.</p>")
    parts.append(_table(rows))
    return "\n".join([*parts, "</main></body></html>"]) + "\n"


def _table(rows: Sequence[Row]) -> str:
    """Failed jobs, failed gates and outliers first, then the others by rank."""
    first = heapq.nsmallest(
        MOST_ROWS, rows, key=lambda row: (not _is_bad(row), row["rank"] or 0, row["name"])
    )
    head = "".join(f"<th>{title}</th>" for _, title in _COLUMNS)
    body = "\n".join(map(_line, first))
    more = len(rows) - MOST_ROWS
    rest = f"<p>{more} more in summary.csv.</p>" if more > 0 else ""
    return f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>\n{body}\n</tbody></table></div>{rest}'


def _is_bad(row: Row) -> bool:
    return row["status"] != DONE or row["verdict"] != "pass" or bool(row["outlier"])


def _line(row: Row) -> str:
    cells = []
    for key, _ in _COLUMNS:
        value = row.get(key)
        text = f"{value:.5g}" if isinstance(value, float) else "" if value is None else str(value)
        text = escape(text)
        if key == "name" and row["status"] == DONE:
            text = f'<a href="{escape(_address(row["name"]))}.yaml">{text}</a>'
        cells.append(f"<td>{text}</td>")
    mark = ' class="bad"' if _is_bad(row) else ""
    return f"<tr{mark}>{''.join(cells)}</tr>"


def _address(name: str) -> str:
    from urllib.parse import quote

    return quote(name)


def _figure(control: Control, number: int) -> str:
    chart = control_chart(control)
    title = escape(f"{chart.title}: {chart.text}")
    return f"<figure>{svg(chart, f'control-{number}')}<figcaption>{title}</figcaption></figure>"


def control_chart(control: Control) -> Chart:
    """A control chart: each camera in the order of the jobs, the median, and the limits."""
    title = control.title
    count = len(control.values)
    place = np.arange(1.0, count + 1)
    outliers = control.outliers
    bad = np.array([name in outliers for name in control.names])
    shown = ~bad & ((place - 1) % max(1, -(-count // MOST_DOTS)) == 0)
    reach = control.limit * control.spread
    low, high = (
        min(control.values.min(), control.centre - reach),
        max(control.values.max(), control.centre + reach),
    )
    margin = 0.05 * (high - low) or 1.0
    ends = np.array([0.5, count + 0.5])

    def level(value: float, dashed: bool) -> Line:
        return Line(np.c_[ends, [value, value]], "faint", dashed=dashed)

    layers: list[Layer] = [
        level(control.centre, False),
        level(control.centre + reach, True),
        level(control.centre - reach, True),
        Points(np.c_[place, control.values][shown], radius=2.2),
        Points(
            np.c_[place, control.values][bad], "bad", 3.5, titles=[n for n in control.names if n in outliers]
        ),
    ]
    names = listed([f"{name} ({z:+.1f})" for name, z in outliers.items()], 10)
    said = f"Outliers: {names}." if outliers else "No outlier."
    return Chart(
        f"{control.type}, {title}",
        f"Median {control.centre:.6g}, scatter between cameras {control.spread:.3g}, limits at {control.limit:.1f} "
        f"of it. {said}",
        "camera, counted in the order of the jobs",
        title,
        tuple(ends.tolist()),
        (low - margin, high + margin),
        tuple(layers),
    )
