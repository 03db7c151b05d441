"""A target on a sheet of paper: everything in millimetres from the sheet's upper left corner, y downward."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from camcal.detect.targets.base import Target
from camcal.errors import UsageError

Array = np.ndarray

MILLIMETRES = {"um": 1e-3, "mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}
PAGES = {  # short and long side, mm
    "a0": (841.0, 1189.0),
    "a1": (594.0, 841.0),
    "a2": (420.0, 594.0),
    "a3": (297.0, 420.0),
    "a4": (210.0, 297.0),
    "a5": (148.0, 210.0),
    "letter": (215.9, 279.4),
    "legal": (215.9, 355.6),
    "tabloid": (279.4, 431.8),
}
RULER_STRIP = 12.0  #: mm below the target for the ruler mark and the caption
TICK = 10.0  #: mm between the ticks of the ruler mark
LONGEST_RULER = 100.0
LINE = 0.2  #: mm, width of the ruler's lines


@dataclass(frozen=True)
class Sheet:
    """What is printed.

    Attributes
    ----------
    width, height : float
        mm.
    polygons : tuple of (K, 2) arrays
    circles : (C, 3) array
        x, y, radius.
    lines : tuple of (x0, y0, x1, y1)
        The ruler mark, `LINE` wide.
    caption : str
    caption_at : (x, y)
        Left end of its base line.
    """

    width: float
    height: float
    polygons: tuple[Array, ...]
    circles: Array
    lines: tuple[tuple[float, float, float, float], ...]
    caption: str
    caption_at: tuple[float, float]


def lay_out(target: Target, spec: str, page: str | None = None) -> Sheet:
    """Put a target in the middle of a page, or on a sheet of its own size, with a ruler mark below.

    Parameters
    ----------
    target : Target
    spec : str
        What the caption calls it.
    page : str, optional
        A name of `PAGES` in either direction, or `300x200` in mm.

    Raises
    ------
    UsageError
        Where the target has no unit of length, or does not fit on the page.
    """
    if target.unit not in MILLIMETRES:
        raise UsageError(
            f"{target.kind} of {target.columns}x{target.rows} has no length and cannot be printed to scale.",
            f"Give the length with its unit ({', '.join(MILLIMETRES)}), as in checkerboard:9x6:25mm.",
        )
    scale, pattern = MILLIMETRES[target.unit], target.pattern()
    x0, y0, x1, y1 = (scale * v for v in pattern.extent)
    width, height = x1 - x0, y1 - y0 + RULER_STRIP
    page_width, page_height = page_size(page, width, height) if page else (width, height)
    if width > page_width + 1e-6 or height > page_height + 1e-6:
        raise UsageError(
            f"the target needs {width:.0f} x {height:.0f} mm with its margin; {page} has "
            f"{page_width:.0f} x {page_height:.0f}.",
            "Take a larger page or smaller squares.",
        )
    shift = np.array([(page_width - width) / 2 - x0, (page_height - height) / 2 - y0])
    circles = np.asarray(pattern.circles, float).reshape(-1, 3) * scale
    circles[:, :2] += shift
    polygons = tuple(np.asarray(p, float) * scale + shift for p in pattern.polygons)
    left, top = shift[0] + x0 + 5, shift[1] + y1 + 5
    ruler = min(LONGEST_RULER, TICK * np.floor((width - 10) / TICK))
    caption = f"{spec}, camcal. " + (f"The ruler is {ruler:g} mm long: print at 100 %." if ruler > 0 else "")
    return Sheet(
        page_width, page_height, polygons, circles, ruler_mark(left, top, ruler), caption, (left, top + 5.5)
    )


def ruler_mark(left: float, top: float, length: float) -> tuple[tuple[float, float, float, float], ...]:
    """A line of that length with a tick every 10 mm."""
    if length <= 0:
        return ()
    ticks = [(left + t, top, left + t, top + 2.0) for t in np.arange(0, length + 1e-9, TICK)]
    return ((left, top, left + length, top), *ticks)


def page_size(page: str, width: float, height: float) -> tuple[float, float]:
    """Width and height of a page, turned the way in which the target is longer.

    Raises
    ------
    UsageError
        Where the name is unknown.
    """
    named = re.fullmatch(r"([0-9.]+)x([0-9.]+)", page.strip().lower())
    if named:
        try:
            return float(named[1]), float(named[2])
        except ValueError:
            pass
    size = PAGES.get(page.strip().lower())
    if size is None:
        raise UsageError(f"unknown page '{page}'.", "Known: " + ", ".join(PAGES) + ", or WIDTHxHEIGHT in mm.")
    short, long = size
    return (long, short) if width > height else (short, long)
