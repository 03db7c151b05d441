"""A second search, with locally equalised contrast, of pictures in which the usual search found nothing.

A low-contrast target beside something bright (a lamp, a window) occupies a small part of the grey-value range, so
that stretching the whole picture does not help. Equalising the histogram of each region (Pizer et al., Adaptive
histogram equalization and its variations, 1987, with limited contrast and maps interpolated between regions) assigns
grey values a range according to the area that they cover, whatever the brightest ones are. Only the search uses the
equalised picture: points are fitted in the original.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import TypeVar

import cv2
import numpy as np

from camcal.detect.pyramid import WEAK_BLUR, as_float, grey_range, seen_as

Array = np.ndarray
T = TypeVar("T")

#: regions along each side of a picture; a region must contain light and dark squares of the board: with 4, a board of
#: 4x3 corners that fills the picture has two squares in each
REGIONS = 4
#: grey levels of the weakest contrast that is fully raised; the histogram is smoothed over as many, so that the gap
#: between the values of light and dark is included
WEAKEST = 4
#: largest amplification of the contrast: 4 grey levels become 64, the range above which detectors need no stretching
#: (`pyramid.WEAK`); noise of one level, half of it after the blur, becomes 8, as much as their lowest threshold
MOST_GAIN = 16.0
STEPS = 8  #: steps per grey level in the histogram; the blur produces fractional levels


def evened(gray: Array) -> Array:
    """The picture in 8 bits, slightly blurred, with the histogram of each region equalised.

    Parameters
    ----------
    gray : (height, width) uint8 or uint16 array
    """
    smooth = cv2.GaussianBlur(as_float(gray, grey_range(gray)), (0, 0), WEAK_BLUR)
    fine = np.clip(smooth * STEPS, 0, 256 * STEPS - 1).astype(np.uint16)
    rows, columns = (np.linspace(0, n, REGIONS + 1).astype(int) for n in fine.shape)
    maps = [[_equalising(fine[a:b, c:d]) for c, d in pairwise(columns)] for a, b in pairwise(rows)]
    made = np.empty(fine.shape, np.uint8)
    for top, bottom, (i, down), (j, up) in _between(rows):
        for left, right, (k, out), (m, back) in _between(columns):
            part = fine[top:bottom, left:right]
            above, below = (maps[n][k][part] * out + maps[n][m][part] * back for n in (i, j))
            made[top:bottom, left:right] = above * down[:, None] + below * up[:, None]
    return made


def _equalising(region: Array) -> Array:
    """The map (256 STEPS,) float32 from the steps of a region to 0 to 255: a cumulative histogram of limited slope."""
    share = np.bincount(region.ravel(), minlength=256 * STEPS) / max(region.size, 1)
    width = WEAKEST * STEPS
    rise = np.minimum(np.convolve(share, np.full(width, 1 / width), "same"), MOST_GAIN / (255 * STEPS))
    total = np.cumsum(rise)
    return (255 * (total + 0.5 * (1 - total[-1]))).astype(np.float32)


def _between(edges: Array) -> list[tuple[int, int, tuple[int, Array], tuple[int, Array]]]:
    """Intervals of a side between centres of regions: start, end, and the two nearest regions with their weights."""
    middles = 0.5 * (edges[:-1] + edges[1:])
    bounds = [0, *middles.astype(int).tolist(), int(edges[-1])]
    parts = []
    for n, (start, end) in enumerate(pairwise(bounds)):
        first, second = max(n - 1, 0), min(n, len(middles) - 1)
        apart = max(middles[second] - middles[first], 1.0)
        weight = np.clip((np.arange(start, end) - middles[first]) / apart, 0, 1).astype(np.float32)
        parts.append((start, end, (first, 1 - weight), (second, weight)))
    return parts


def with_second_look(gray: Array, search: Callable[[], T], again: Callable[[T], bool]) -> T:
    """Search a picture; if nothing is found, search the picture with equalised contrast.

    Parameters
    ----------
    gray : (height, width) uint8 or uint16 array
    search : callable
        The search of `gray`; see `pyramid.to_search`.
    again : callable
        Returns whether a result is so empty that a second search is worthwhile.
    """
    first = search()
    if not again(first):
        return first
    with seen_as(gray, evened(gray)):
        second = search()
    return first if again(second) else second
