"""A target on a sheet of paper: everything in millimetres from the sheet's upper left corner, y downward."""

from __future__ import annotations

import re

import numpy as np

from camcal.detect.targets.base import Target
from camcal.errors import UsageError
from camcal.records import dataclass

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
OWN = "own"  #: name of a page that is as large as the target needs
AUTO = "auto"  #: the first of `COMMON` on which the target fits
COMMON = ("a4", "letter", "a3", "tabloid", "a2", "a1", "a0")
#: mm of margin that printers cannot print: most leave 3 to 5, some 6.4 (a quarter of an inch) on one side
UNPRINTED = 6.5
#: of the quiet margin that the rulers leave white: its outer part only separates outlines from the edge of the paper,
#: and is beyond the windows of all corner fits
CLEAR = 0.6
ROUNDING = 1e-6  #: mm; by which a sheet may exceed its page: rounding of sums of lengths
GAP = 5.0  #: mm; least distance from the target to a ruler
TICK = 10.0  #: mm between the ticks of a ruler
TICK_LENGTH = 2.0  #: mm; fits into the margin beside the target
#: mm; on it, a scale error of 0.2 % makes 0.2 mm, which is visible on a steel rule
LONGEST_RULER = 100.0
LINE = 0.2  #: mm, width of the rulers' lines
NUMBER = 1.7  #: mm; type size of a ruler's numbers, whose digits fit between the ends of its ticks
DIGIT = 0.556  #: of the type size; width of a digit in Helvetica
LETTER = 1.5  #: mm; mean width of a letter of the caption, which is 3 mm high
CAPTION_DROP = 5.5  #: mm from the lower ruler to the baseline of the caption
#: mm from the white around the target to the edge of the strip: the ruler on the left, the lower one and the caption
STRIPS = (TICK_LENGTH + 0.5, CAPTION_DROP + 0.5)


@dataclass(frozen=True)
class Sheet:
    """The contents of a sheet.

    Attributes
    ----------
    width, height : float
        mm.
    polygons : tuple of (K, 2) arrays
    circles : (C, 3) array
        x, y, radius.
    lines : tuple of (x0, y0, x1, y1)
        The rulers, `LINE` wide: first the one below the target, then the one on its left.
    numbers : tuple of (text, x, y)
        Labels of the rulers' ticks, cm, each with the left end of its baseline; the letters are `NUMBER` mm high.
    caption : str
    caption_at : (x, y)
        Left end of its baseline.
    page : str
        Name of the paper.
    origin : (x, y)
        Position of the target's origin.
    instructions : tuple of str
        How to print, measure and mount it, one paragraph each.
    """

    width: float
    height: float
    polygons: tuple[Array, ...]
    circles: Array
    lines: tuple[tuple[float, float, float, float], ...]
    numbers: tuple[tuple[str, float, float], ...]
    caption: str
    caption_at: tuple[float, float]
    page: str
    origin: tuple[float, float]
    instructions: tuple[str, ...]


def lay_out(target: Target, spec: str, page: str = OWN) -> Sheet:
    """Centre a target on a page, with a ruler below and one on the left.

    Nothing is printed closer to the edge of the paper than `UNPRINTED`.

    Parameters
    ----------
    target : Target
    spec : str
        Its name in the caption.
    page : str
        A name of `PAGES` in either orientation, `300x200` in mm, `own` for a sheet of the target's own size, or
        `auto` for the smallest common page on which it fits.

    Raises
    ------
    UsageError
        If the target has no unit of length, is a negative, or does not fit on the page.
    """
    polygons, circles, quiet = _shapes(target)
    width, height, right, above = _needed(quiet, _black(polygons, circles))
    name, (page_width, page_height) = _page(page, width, height)
    # centred, as far as the rulers on the left and below remain printable
    left = min(max(UNPRINTED, (page_width - width + UNPRINTED + right) / 2), page_width - width + UNPRINTED)
    top = max(above, min((page_height - height + UNPRINTED + above) / 2, page_height - height + above))
    shift = np.array([left + STRIPS[0], top]) - quiet[:2]
    circles[:, :2] += shift
    polygons = [p + shift for p in polygons]
    (x0, y0), (x1, y1) = quiet[:2] + shift, quiet[2:] + shift
    start = max(y0, UNPRINTED)
    lengths = _ruler_length(min(x1, page_width - UNPRINTED) - x0), _ruler_length(y1 - start)
    across = ruler((x0, y1), lengths[0], False)
    down = ruler((x0 - TICK_LENGTH, start), lengths[1], True)
    caption = f"{spec}, camcal. {_ruler_words(lengths)}: print at 100 %."
    if len(caption) * LETTER > page_width - UNPRINTED - x0:
        caption = spec
    return Sheet(
        page_width,
        page_height,
        tuple(polygons),
        circles,
        (*across, *down),
        (*numbers(across, False), *numbers(down, True)),
        caption,
        (float(x0), float(y1 + CAPTION_DROP)),
        name,
        (float(shift[0]), float(shift[1])),
        _instructions(target, lengths),
    )


def _shapes(target: Target) -> tuple[list[Array], Array, Array]:
    """The polygons (K, 2), circles (C, 3: x, y, radius) and quiet margin (x0, y0, x1, y1) of a target to print, mm."""
    if target.unit not in MILLIMETRES:
        raise UsageError(
            f"{target.kind} of {target.columns}x{target.rows} has no unit of length and cannot be printed to scale.",
            f"Give the length with its unit ({', '.join(MILLIMETRES)}), as in checkerboard:9x6:25mm.",
        )
    if target.negative:
        raise UsageError(
            "a board with black and white exchanged cannot be printed.",
            "Leave out `negative`, and invert the colours when printing if the board has to be black.",
        )
    scale, pattern = MILLIMETRES[target.unit], target.pattern()
    circles = np.asarray(pattern.circles, float).reshape(-1, 3) * scale
    polygons = [np.asarray(p, float) * scale for p in pattern.polygons]
    return polygons, circles, _clear_of_rulers(scale * np.array(pattern.extent), _black(polygons, circles))


def _black(polygons: list[Array], circles: Array) -> Array:
    """Points (N, 2) that bound the black shapes, mm."""
    discs = [circles[:, :2] + sign * circles[:, 2:] for sign in (-1, 1)]
    return np.concatenate([*polygons, *discs])


def _clear_of_rulers(quiet: Array, black: Array) -> Array:
    """The quiet margin (x0, y0, x1, y1), reduced on the left and below to the white space within the rulers, mm."""
    white = black[:, 0].min() - quiet[0], quiet[3] - black[:, 1].max()
    left, below = (max(GAP, CLEAR * float(w)) for w in white)
    return np.array([black[:, 0].min() - left, quiet[1], quiet[2], black[:, 1].max() + below])


def _needed(quiet: Array, black: Array) -> tuple[float, float, float, float]:
    """The width and height of the paper, and the parts to the right of and above the quiet margin, mm.

    The quiet margin (x0, y0, x1, y1) may extend into the unprintable margin of the paper, black shapes may not.
    """
    right = max(0.0, UNPRINTED - float(quiet[2] - black[:, 0].max()))
    above = max(0.0, UNPRINTED - float(black[:, 1].min() - quiet[1]))
    size = quiet[2:] - quiet[:2] + STRIPS + np.array(UNPRINTED)
    return float(size[0]) + right, float(size[1]) + above, right, above


def _page(page: str, width: float, height: float) -> tuple[str, tuple[float, float]]:
    """The name and size of the paper on which something of that size can be printed."""
    wanted = page.strip().lower()
    if wanted == OWN:
        return OWN, (width, height)
    if wanted == AUTO:
        fitting = [name for name in COMMON if _fits((width, height), page_size(name, width, height))]
        return (fitting[0], page_size(fitting[0], width, height)) if fitting else (OWN, (width, height))
    size = page_size(page, width, height)
    if not _fits((width, height), size):
        raise UsageError(
            f"the target needs {width:.0f} x {height:.0f} mm with its margin and rulers; {page} has "
            f"{size[0]:.0f} x {size[1]:.0f}.",
            "Use a larger page or smaller squares, or omit --page.",
        )
    return wanted, size


def _fits(needed: tuple[float, float], size: tuple[float, float]) -> bool:
    return needed[0] <= size[0] + ROUNDING and needed[1] <= size[1] + ROUNDING


def _ruler_length(room: float) -> float:
    return float(min(LONGEST_RULER, TICK * np.floor(room / TICK)))


def _ruler_words(lengths: tuple[float, float]) -> str:
    if lengths[0] == lengths[1]:
        return f"Both rulers are {lengths[0]:g} mm long"
    return f"The lower ruler is {lengths[0]:g} mm long, the one on the left {lengths[1]:g} mm"


def _instructions(target: Target, lengths: tuple[float, float]) -> tuple[str, ...]:
    """Instructions for printing, measuring and mounting a target."""
    return (
        'Print at 100 % ("actual size"), not fitted to the page, on matt paper.',
        f"Measure both rulers with a steel rule or calipers. {_ruler_words(lengths)}. If both are off by the same "
        "factor, multiply the lengths of the target in this file by it. If they differ from each other by more than "
        "0.2 %, the printer stretches the page: use another printer, or calibrate with --board-shape print.",
        "For an accurate scale, measure across all squares, not across a single one.",
        "Glue the sheet all over to something flat and stiff: float glass, an aluminium composite panel, or the like. "
        "Hold a straight edge against it in all directions: a gap of a thousandth of its width causes a "
        "larger error than any corner detector. Do not laminate it: glare hides corners.",
        "Take 15 to 30 pictures, with the board in all parts of the picture, tilted by 20 to 45 degrees in all "
        "directions, near and far, with focus and zoom fixed.",
    )


def ruler(
    start: tuple[float, float], length: float, downward: bool
) -> tuple[tuple[float, float, float, float], ...]:
    """A line of a given length to the right or downward, with a tick every 10 mm."""
    if length <= 0:
        return ()
    x, y = (float(v) for v in start)
    at = np.arange(0, length + 1e-9, TICK).tolist()
    if downward:
        ticks = [(x, y + t, x + TICK_LENGTH, y + t) for t in at]
        return ((x, y, x, y + length), *ticks)
    ticks = [(x + t, y, x + t, y + TICK_LENGTH) for t in at]
    return ((x, y, x + length, y), *ticks)


def numbers(
    lines: tuple[tuple[float, float, float, float], ...], downward: bool
) -> tuple[tuple[str, float, float], ...]:
    """The labels of a ruler's ticks, cm: to the left of each tick, or above it on a vertical ruler.

    Parameters
    ----------
    lines : tuple of (x0, y0, x1, y1)
        From `ruler`: the ruler itself, then its ticks.
    """
    found = []
    for centimetres, (x, y, _, end) in enumerate(lines[2:], 1):  # the tick at 0 has no label
        text = str(centimetres)
        width = DIGIT * NUMBER * len(text)
        found.append((text, x + 2 * LINE, y - 2 * LINE) if downward else (text, x - width - 2 * LINE, end))
    return tuple(found)


def page_size(page: str, width: float, height: float) -> tuple[float, float]:
    """The width and height of a page, in the orientation of the target.

    Raises
    ------
    UsageError
        If the name is unknown.
    """
    named = re.fullmatch(r"([0-9.]+)x([0-9.]+)", page.strip().lower())
    if named:
        try:
            return float(named[1]), float(named[2])
        except ValueError:
            pass
    size = PAGES.get(page.strip().lower())
    if size is None:
        raise UsageError(
            f"unknown page '{page}'.", f"Known: {', '.join(PAGES)}, {AUTO}, {OWN}, or WIDTHxHEIGHT in mm."
        )
    short, long = size
    return (long, short) if width > height else (short, long)
