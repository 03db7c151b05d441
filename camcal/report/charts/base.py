"""The data of a chart: axes and layers, independent of the drawing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from typing import Literal

import numpy as np

from camcal.records import dataclass

Array = np.ndarray

#: ratios of the ends of a logarithmic scale: below the first, equally spaced ticks are as good; above the second, 1
#: and 3 of each decade are sufficient
LEAST_RATIO, TWO_DECADES = 5, 100
#: relative error up to which a number counts as 1, 2 or 5 times a power of ten
ROUNDED = 1e-3
#: largest distance of a tick from the end of an axis, in steps between ticks
ON_TICK = 1e-9

#: Roles of layers, to which each drawing assigns its own colours. `text` is that of letters, `accent` the data's,
#: `second` another series, `bad` what asks for attention, `faint` what is there for orientation,
#: `hull` an outline over a map, whose colours are the same in the dark.
Tone = Literal["text", "accent", "second", "bad", "faint", "hull"]


@dataclass(frozen=True)
class Line:
    """A polyline through xy (N, 2); `closed` joins its ends, `filled` shades the inside, `heavy` is wider."""

    xy: Array
    tone: Tone = "accent"
    label: str = ""
    dashed: bool = False
    closed: bool = False
    filled: bool = False
    heavy: bool = False


@dataclass(frozen=True)
class Points:
    """Dots at xy (N, 2); `radius` in px of a drawing 640 wide, `titles` label single ones."""

    xy: Array
    tone: Tone = "accent"
    radius: float = 1.6
    label: str = ""
    titles: Sequence[str] = ()


@dataclass(frozen=True)
class Arrows:
    """Arrows from xy (N, 2) by `by` (N, 2), in units of the axes."""

    xy: Array
    by: Array
    tone: Tone = "accent"
    label: str = ""


@dataclass(frozen=True)
class Bars:
    """Bars from 0 to `heights`, between the edges (N + 1,) or about the whole numbers 0, 1, ...

    `names` stand below them (where there is room) and name them to a pointer; `bad` marks some.
    """

    heights: Array
    edges: Array | None = None
    names: Sequence[str] = ()
    bad: Array | None = None
    tone: Tone = "accent"
    label: str = ""

    @property
    def sides(self) -> tuple[Array, Array]:
        """Left and right of each bar."""
        if self.edges is not None:
            return self.edges[:-1], self.edges[1:]
        at = np.arange(len(self.heights))
        return at - 0.4, at + 0.4


@dataclass(frozen=True)
class Cells:
    """A map: values (R, C) around the columns x (C,) and rows y (R,); NaN is blank, inf the last colour."""

    x: Array
    y: Array
    values: Array
    unit: str
    centred: bool = False  #: colours diverge from 0
    logarithmic: bool = False  #: values are positive, and equal ratios are equal steps of colour

    @property
    def limits(self) -> tuple[float, float]:
        """The values at the two ends of the colour scale."""
        found = self.values[np.isfinite(self.values)]
        if not len(found):
            return 0.0, 1.0
        low, high = float(found.min()), float(found.max())
        if self.centred:
            high = max(abs(low), abs(high))
            low = -high
        return (low, high) if high > low else (low, low + 1e-12 + abs(low))

    def part(self, values: Array) -> Array:
        """The positions of values on the colour scale, 0 to 1."""
        low, high = self.limits
        values = np.minimum(np.asarray(values, float), high)
        if self.logarithmic and low > 0:
            return np.asarray(np.log(values / low) / np.log(high / low))
        return np.asarray((values - low) / (high - low))

    @property
    def marks(self) -> list[float]:
        """Round numbers for the colour scale."""
        low, high = self.limits
        if not self.logarithmic or low <= 0 or high < LEAST_RATIO * low:
            return ticks(low, high, wanted=5)
        powers = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
        steps = (1, 3) if high > TWO_DECADES * low else (1, 2, 5)
        return [m * 10.0**p for p in powers for m in steps if low <= m * 10.0**p <= high]


Layer = Line | Points | Arrows | Bars | Cells


@dataclass(frozen=True)
class Chart:
    """A chart.

    Attributes
    ----------
    title, text : str
        Title, and what the chart shows, in one or two sentences: the caption, and the description for readers
        who cannot see the picture.
    x_label, y_label : str
    x, y : (low, high)
        The limits of the axes.
    layers : tuple
        Drawn in this order.
    picture : bool
        The axes are those of a picture: y points down, both at the same scale.
    """

    title: str
    text: str
    x_label: str
    y_label: str
    x: tuple[float, float]
    y: tuple[float, float]
    layers: tuple[Layer, ...] = field(default_factory=tuple)
    picture: bool = False

    @property
    def named_bars(self) -> Bars | None:
        """Bars with names below, instead of numbers on the axis."""
        return next((b for b in self.layers if isinstance(b, Bars) and b.names), None)


def round_down(value: float) -> float:
    """The largest of 1, 2, 5, 10, ... that is no larger."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(m * power for m in (1, 2, 5) if m * power <= value * (1 + ROUNDED)))


def ticks(low: float, high: float, wanted: int = 6) -> list[float]:
    """Round numbers from `low` to `high`, about `wanted` of them (1, 2 or 5 times a power of ten apart)."""
    span = high - low
    if not np.isfinite(span) or span <= 0:
        return [low]
    raw = span / max(wanted, 1)
    power = 10.0 ** np.floor(np.log10(raw))
    step = next((m for m in (1, 2, 5, 10) if m * power >= raw * (1 - ROUNDED)), 10) * power
    first = np.ceil(low / step - ON_TICK)
    count = int(np.floor(high / step + ON_TICK) - first) + 1
    return [float(round((first + i) * step, 12)) for i in range(max(count, 0))]


def tick_text(value: float) -> str:
    """A number at an axis tick."""
    return f"{value:.6g}".replace("-", "\N{MINUS SIGN}")


def short(value: float) -> str:
    """A number with three digits, without an exponent if it is of ordinary size."""
    return f"{float(f'{value:.3g}'):g}"
