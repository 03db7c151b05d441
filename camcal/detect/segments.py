"""Straight segments of a picture, by cv2's line segment detector (Grompone von Gioi et al., LSD, 2012)."""

from __future__ import annotations

import cv2
import numpy as np

from camcal.detect.pyramid import to_8_bits
from camcal.detect.segment_fit import refined

Array = np.ndarray

#: px; the direction of shorter segments is uncertain: half a pixel at either end makes 3 degrees or more
SHORTEST = 20.0


def find_segments(gray: Array) -> Array:
    """End points (N, 2, 2) of the segments of a grey picture, px, the longest first."""
    grey = to_8_bits(gray)
    found = cv2.createLineSegmentDetector(cv2.LSD_REFINE_ADV).detect(grey)[0]
    if found is None:
        return np.zeros((0, 2, 2))
    # its half-size grid moves positions by (1 / 0.8 - 1) / 2 px
    ends = np.asarray(found, float).reshape(-1, 2, 2) + 0.125
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    order = np.argsort(-length, kind="stable")
    return refined(grey, ends[order][length[order] >= SHORTEST])
