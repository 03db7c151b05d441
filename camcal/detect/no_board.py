"""Why a picture shows no board, as far as its grey values indicate."""

from __future__ import annotations

import cv2
import numpy as np

from camcal.detect.pyramid import as_float, grey_range, reduced
from camcal.detect.targets.base import Miss

Array = np.ndarray

LEAST_PIXELS = 16  #: to each side
LONG_SIDE = 640  #: px; length to which the longer side of the picture is reduced
DARK, BRIGHT = 30.0, 240.0  #: grey levels of 255; a picture almost all below (above) is too dark (bright)
#: percentiles of the grey values that count as the darkest and the brightest: a reflection, or the dark corners of a
#: lens, cover less than 1 or 2 % of a picture that shows anything else
RANGE = (2, 99)
#: share of the picture's contrast by which 1 pixel in 200 (that percentile) differs from its neighbourhood of 2 px
SHARP, FINEST = 0.03, 99.5


def why_nothing(gray: Array) -> Miss:
    """The simplest reason why a picture shows no board."""
    if min(gray.shape) < LEAST_PIXELS:
        return Miss(
            "too-small", f"the picture has {gray.shape[1]}x{gray.shape[0]} pixels: too small for a board"
        )
    small = as_float(reduced(gray, float(max(1, max(gray.shape) // LONG_SIDE))), grey_range(gray))
    low, high = np.percentile(small, RANGE)
    if high < DARK:
        return Miss("too-dark", f"the picture is too dark: {RANGE[1]}% of it is below {high:.0f} of 255")
    if low > BRIGHT:
        return Miss(
            "too-bright", f"the picture is too bright: {100 - RANGE[0]}% of it is above {low:.0f} of 255"
        )
    fine = small - cv2.GaussianBlur(small, (0, 0), 2)
    if np.percentile(np.abs(fine), FINEST) < SHARP * (high - low):
        return Miss("too-blurred", "the picture is too blurred: it shows no sharp edge")
    return Miss("none", "no checkerboard was found")
