"""Smaller versions of a picture for the first search, in the 8 bits that cv2's detectors take."""

from __future__ import annotations

import cv2
import numpy as np

Array = np.ndarray

FIRST_PIXELS = 1.5e6  #: size to which a picture is reduced for the first search


def to_8_bits(gray: Array) -> Array:
    """The picture in 8 bits for cv2's detectors; one of 16 bits is stretched to its own range."""
    if gray.dtype == np.uint8:
        return gray
    low, high = float(gray.min()), float(gray.max())
    return ((gray - low) * (255.0 / max(high - low, 1.0))).astype(np.uint8)


def reductions(shape: tuple[int, ...], enlarge: bool = False) -> list[float]:
    """Factors by which a picture is reduced, the coarsest first, 1 last; then 1/2 to enlarge a small one."""
    factors, pixels = [1.0], shape[0] * shape[1]
    while pixels / factors[0] ** 2 > FIRST_PIXELS:
        factors.insert(0, 2 * factors[0])
    return [*factors, 0.5] if enlarge and pixels <= FIRST_PIXELS else factors


def reduced(picture: Array, factor: float) -> Array:
    """The picture `factor` times smaller; pixel u of it is (u + 0.5) factor - 0.5 of the picture."""
    if factor == 1:
        return picture
    how = cv2.INTER_AREA if factor > 1 else cv2.INTER_CUBIC
    return cv2.resize(picture, None, fx=1 / factor, fy=1 / factor, interpolation=how)
