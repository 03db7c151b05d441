"""A chart as inline SVG; colours come from the page's style sheet, so that dark mode and print work."""

from __future__ import annotations

import math
from collections.abc import Callable
from html import escape

import numpy as np

from camcal.records import dataclass
from camcal.report.charts.base import Arrows, Bars, Cells, Chart, Line, Points, tick_text, ticks
from camcal.report.charts.colours import css_colour

Array = np.ndarray

WIDTH = 640
#: of charts that are not pictures
HEIGHT = 360
LEFT, RIGHT, TOP, BOTTOM = 78, 16, 16, 56
BAR_OF_COLOURS = 84  #: room for the scale beside a map
LEGEND_LINE = 24
LETTER = 8.0  #: width of a letter beside an axis
LONGEST_NAME = 12
TALLEST = 620.0  #: of a picture in portrait format, which would exceed a screen at full width
TICK_WIDTH, TICK_HEIGHT, LEAST_TICKS = 80, 45, 3  #: room for a tick with its number; two show no scale
LEAST_HEAD, HEAD, HEAD_PART = (
    4,
    4.0,
    0.4,
)  #: a head of at most this size, or part of the arrow; none on shorter ones
BAR_GAP, LEAST_BAR = 0.6, 0.8  #: between bars, and the width of one that can still be seen
MANY_NAMES = 6  #: names below bars from which on a page on a narrow screen drops every other one


@dataclass(frozen=True)
class _Frame:
    """The position of the axes in the drawing."""

    chart: Chart
    left: float
    top: float
    width: float
    height: float

    def xy(self, points: Array) -> Array:
        points = np.reshape(np.asarray(points, float), (-1, 2))
        return np.c_[self.x(points[:, 0]), self.y(points[:, 1])]

    def x(self, values: Array) -> Array:
        low, high = self.chart.x
        return self.left + (np.asarray(values, float) - low) / (high - low) * self.width

    def y(self, values: Array) -> Array:
        low, high = self.chart.y
        part = (np.asarray(values, float) - low) / (high - low)
        return self.top + (part if self.chart.picture else 1 - part) * self.height


def svg(chart: Chart, name: str) -> str:
    """Draw a chart; `name` makes the ids of its title and description unique on a page."""
    scale = any(isinstance(layer, Cells) for layer in chart.layers)
    legend = [layer for layer in chart.layers if getattr(layer, "label", "")]
    width = float(WIDTH - LEFT - RIGHT - (BAR_OF_COLOURS if scale else 0))
    height = float(HEIGHT - TOP - BOTTOM)
    if chart.picture:
        height = width * (chart.y[1] - chart.y[0]) / (chart.x[1] - chart.x[0])
        if height > TALLEST:
            width, height = width * TALLEST / height, TALLEST
    frame = _Frame(chart, LEFT, TOP + (LEGEND_LINE if legend else 0), width, height)
    total = frame.top + height + BOTTOM
    body = [_grid(frame), f'<g clip-path="url(#{name}-clip)">']
    body += [_DRAW[type(layer)](layer, frame) for layer in chart.layers]
    body += ["</g>", _axes(frame), _legend(legend, frame)]
    if scale:
        body += [_scale(layer, frame) for layer in chart.layers if isinstance(layer, Cells)]
    clip = (
        f'<clipPath id="{name}-clip"><rect x="{frame.left:.1f}" y="{frame.top:.1f}" '
        f'width="{width:.1f}" height="{height:.1f}"/></clipPath>'
    )
    return (
        f'<svg class="chart" viewBox="0 0 {WIDTH} {total:.0f}" role="img" '
        f'aria-labelledby="{name}-title {name}-text" xmlns="http://www.w3.org/2000/svg">'
        f'<title id="{name}-title">{escape(chart.title)}</title><desc id="{name}-text">{escape(chart.text)}'
        f"</desc><defs>{clip}</defs>{''.join(body)}</svg>"
    )


# ------------------------------------------------------------------ axes
def _ticks(frame: _Frame) -> tuple[list[float], list[float]]:
    chart = frame.chart
    return (
        ticks(*chart.x, wanted=max(LEAST_TICKS, int(frame.width // TICK_WIDTH))),
        ticks(*chart.y, wanted=max(LEAST_TICKS, int(frame.height // TICK_HEIGHT))),
    )


def _grid(frame: _Frame) -> str:
    across, up = _ticks(frame)
    parts = [
        f'<rect class="frame" x="{frame.left:.1f}" y="{frame.top:.1f}" width="{frame.width:.1f}" '
        f'height="{frame.height:.1f}"/>'
    ]
    if not frame.chart.picture:
        right = frame.left + frame.width
        parts += [
            f'<line class="grid" x1="{frame.left:.1f}" x2="{right:.1f}" y1="{y:.1f}" y2="{y:.1f}"/>'
            for y in frame.y(np.array(up))
        ]
        if frame.chart.named_bars is None:
            bottom = frame.top + frame.height
            parts += [
                f'<line class="grid" x1="{x:.1f}" x2="{x:.1f}" y1="{frame.top:.1f}" y2="{bottom:.1f}"/>'
                for x in frame.x(np.array(across))
            ]
    return "".join(parts)


def _axes(frame: _Frame) -> str:
    chart, (across, up) = frame.chart, _ticks(frame)
    bottom = frame.top + frame.height
    bars = chart.named_bars
    parts = [
        f'<text class="tick" text-anchor="end" x="{frame.left - 7:.1f}" y="{y + 5:.1f}">{tick_text(v)}</text>'
        for v, y in zip(up, frame.y(np.array(up)), strict=True)
    ]
    if bars is None:
        parts += [
            f'<text class="tick" text-anchor="middle" x="{x:.1f}" y="{bottom + 20:.1f}">{tick_text(v)}</text>'
            for v, x in zip(across, frame.x(np.array(across)), strict=True)
        ]
    else:  # only as many as fit
        slots = frame.x(np.arange(len(bars.names)))
        names = [_shortened(n) for n in bars.names]
        step = math.ceil((max(map(len, names)) + 1) * LETTER * len(names) / frame.width)
        parts += [
            f'<text class="tick{" odd" if i // step % 2 and len(slots) > MANY_NAMES else ""}" text-anchor="middle" '
            f'x="{x:.1f}" y="{bottom + 20:.1f}">{escape(n)}</text>'
            for i, (n, x) in enumerate(zip(names, slots, strict=True))
            if i % step == 0
        ]
    middle = frame.left + frame.width / 2
    parts.append(
        f'<text class="label" text-anchor="middle" x="{middle:.1f}" y="{bottom + 45:.1f}">'
        f"{escape(chart.x_label)}</text>"
    )
    parts.append(
        '<text class="label" text-anchor="middle" '
        f'transform="translate(18 {frame.top + frame.height / 2:.1f}) rotate(-90)">'
        f"{escape(chart.y_label)}</text>"
    )
    return "".join(parts)


def _shortened(name: str) -> str:
    stem = name.rpartition(".")[0] or name
    return stem if len(stem) <= LONGEST_NAME else "…" + stem[-(LONGEST_NAME - 1) :]


def _legend(layers: list, frame: _Frame) -> str:
    parts, x = [], frame.left
    for layer in layers:
        y = frame.top - 10
        if isinstance(layer, Line):
            dash = ' stroke-dasharray="5 4"' if layer.dashed else ""
            parts.append(
                f'<line class="line {layer.tone}" x1="{x:.1f}" x2="{x + 22:.1f}" y1="{y}" y2="{y}"{dash}/>'
            )
        else:
            parts.append(
                f'<rect class="fill {layer.tone}" x="{x + 6:.1f}" y="{y - 5}" width="10" height="10"/>'
            )
        parts.append(f'<text class="tick" x="{x + 28:.1f}" y="{y + 5}">{escape(layer.label)}</text>')
        x += 46 + 10.5 * len(layer.label)  # room for the larger letters on a phone
    return "".join(parts)


def _scale(cells: Cells, frame: _Frame) -> str:
    """The colour bar beside a map."""
    x, steps = frame.left + frame.width + 12, 48
    height = frame.height / steps
    parts = [
        f'<rect x="{x:.1f}" y="{frame.top + frame.height - (i + 1) * height:.1f}" width="14" '
        f'height="{height + 0.6:.1f}" fill="{css_colour((i + 0.5) / steps, cells.centred)}"/>'
        for i in range(steps)
    ]
    for value in cells.marks:
        y = frame.top + frame.height * (1 - float(cells.part(np.array(value))))
        parts.append(f'<text class="tick" x="{x + 19:.1f}" y="{y + 4:.1f}">{tick_text(value)}</text>')
    parts.append(f'<text class="tick" x="{x:.1f}" y="{frame.top - 6:.1f}">{escape(cells.unit)}</text>')
    return "".join(parts)


# ------------------------------------------------------------------ layers
def _line(layer: Line, frame: _Frame) -> str:
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in frame.xy(layer.xy) if np.isfinite(x + y))
    dash = ' stroke-dasharray="5 4"' if layer.dashed else ""
    kind = "polygon" if layer.closed else "polyline"
    classes = ["line", layer.tone, *(["shaded"] if layer.filled else []), *(["heavy"] if layer.heavy else [])]
    return f'<{kind} class="{" ".join(classes)}" points="{points}"{dash}/>'


def _points(layer: Points, frame: _Frame) -> str:
    places = frame.xy(layer.xy)
    if not layer.titles:
        # one path of dots: a tenth of the size of circles
        dots = "".join(f"M{x:.1f} {y:.1f}h0" for x, y in places if np.isfinite(x + y))
        return f'<path class="dots {layer.tone}" stroke-width="{2 * layer.radius:g}" d="{dots}"/>'
    return "".join(
        f'<circle class="fill {layer.tone}" r="{layer.radius:g}" cx="{x:.1f}" cy="{y:.1f}">'
        f"<title>{escape(t)}</title></circle>"
        for (x, y), t in zip(places, layer.titles, strict=True)
    )


def _arrows(layer: Arrows, frame: _Frame) -> str:
    ends = np.c_[frame.xy(layer.xy), frame.xy(layer.xy + layer.by)]
    path = []
    for a, b, c, d in ends:
        if not np.isfinite(a + b + c + d):
            continue
        length = np.hypot(c - a, d - b)
        path.append(f"M{a:.1f} {b:.1f}L{c:.1f} {d:.1f}")
        if length > LEAST_HEAD:
            ex, ey = (c - a) / length, (d - b) / length
            s = min(HEAD, HEAD_PART * length)
            path.append(
                f"M{c - s * (ex + 0.5 * ey):.1f} {d - s * (ey - 0.5 * ex):.1f}L{c:.1f} {d:.1f}"
                f"L{c - s * (ex - 0.5 * ey):.1f} {d - s * (ey + 0.5 * ex):.1f}"
            )
    return f'<path class="arrows {layer.tone}" d="{"".join(path)}"/>'


def _bars(layer: Bars, frame: _Frame) -> str:
    left, right = (frame.x(s) for s in layer.sides)
    zero = float(frame.y(np.array(max(0.0, frame.chart.y[0]))))
    parts = []
    for i, height in enumerate(layer.heights):
        if not np.isfinite(height):
            continue
        tone = "bad" if layer.bad is not None and layer.bad[i] else layer.tone
        top = float(frame.y(np.array(height)))
        title = f"<title>{escape(layer.names[i])}: {height:.4g}</title>" if layer.names else ""
        linked = f' data-view="{escape(layer.names[i])}"' if layer.names else ""
        width = max(right[i] - left[i] - BAR_GAP, LEAST_BAR)
        parts.append(
            f'<rect class="fill {tone}" x="{left[i]:.1f}" y="{top:.1f}" width="{width:.1f}" '
            f'height="{max(zero - top, 0):.1f}"{linked}>{title}</rect>'
        )
    return "".join(parts)


def _cells(layer: Cells, frame: _Frame) -> str:
    part = layer.part(layer.values)
    left, right = (frame.x(e) for e in _edges(layer.x))
    top, bottom = (frame.y(e) for e in _edges(layer.y))
    parts = []
    for r, row in enumerate(layer.values):
        for c, value in enumerate(row):
            if np.isnan(value):
                continue
            said = f"({layer.x[c]:.0f}, {layer.y[r]:.0f}): {value:.3g} {escape(layer.unit)}"
            parts.append(
                f'<rect x="{left[c]:.1f}" y="{min(top[r], bottom[r]):.1f}" '
                f'width="{right[c] - left[c] + 0.5:.1f}" height="{abs(bottom[r] - top[r]) + 0.5:.1f}" '
                f'fill="{css_colour(part[r, c], layer.centred)}"><title>{said}</title></rect>'
            )
    return f'<g shape-rendering="crispEdges">{"".join(parts)}</g>'


def _edges(centres: Array) -> tuple[Array, Array]:
    """The left and right edges of the cells around sorted centres."""
    if len(centres) < 2:
        return centres - 0.5, centres + 0.5
    middle = (centres[1:] + centres[:-1]) / 2
    first, last = 2 * centres[0] - middle[0], 2 * centres[-1] - middle[-1]
    edges = np.r_[first, middle, last]
    return edges[:-1], edges[1:]


_DRAW: dict[type, Callable] = {
    Line: _line,
    Points: _points,
    Arrows: _arrows,
    Bars: _bars,
    Cells: _cells,
}
