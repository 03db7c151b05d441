"""Two colour scales that are readable with every kind of colour vision, in print and on a dark page."""

from __future__ import annotations

import numpy as np

#: dark blue over green to yellow, even in lightness (the anchors of viridis, van der Walt & Smith 2015)
SEQUENTIAL = ("#440154", "#3b528b", "#21918c", "#5ec962", "#fde725")
#: blue over grey to orange for values that go to both sides of zero
DIVERGING = ("#2166ac", "#92c5de", "#d9d9d9", "#f4a582", "#b35806")


def css_colour(part: float, diverging: bool = False) -> str:
    """The colour at `part` (0 to 1) of a scale, as #rrggbb."""
    anchors = np.array([_rgb(c) for c in (DIVERGING if diverging else SEQUENTIAL)])
    at = float(np.clip(part, 0, 1)) * (len(anchors) - 1)
    low = min(int(at), len(anchors) - 2)
    mixed = anchors[low] + (at - low) * (anchors[low + 1] - anchors[low])
    return "#{:02x}{:02x}{:02x}".format(*(round(c) for c in mixed))


def _rgb(colour: str) -> tuple[int, int, int]:
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)
