"""Reduced versions of a picture for the first search, with grey values stretched to their range."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

import cv2
import numpy as np

from camcal.geometry.numbers import percentiles
from camcal.least_squares.scales import NORMAL_MEDIAN

Array = np.ndarray

FIRST_PIXELS = 1.5e6  #: size to which a picture is reduced for the first search
SAMPLES = 100_000  #: pixels from which the grey-value range of a picture is estimated
#: per cent of the darkest and the brightest 16-bit pixels that are ignored: a sensor of one megapixel has
#: some hundred defective ones
OUTLIERS = 0.1
#: grey levels of 255; a smaller range is stretched for detectors, whose thresholds (8 levels around discs, 30 within
#: markers) are made for pictures that use most of the scale
WEAK = 64.0
#: px; blur of a picture before it is stretched: it removes half of the noise. Markers with cells of 3 px are read with
#: .6 in 6 of 8 rendered pictures of 4 grey levels, with .8 in 4
WEAK_BLUR = 0.6
#: least ratio of the range of the blurred picture to its noise for stretching: the range of noise alone is 2.9 times
#: its standard deviation
SOMETHING = 5.0
#: Immerkaer's mask (Fast noise variance estimation, 1996), which removes planes and edges; its norm is the factor by
#: which it amplifies independent noise
MASK = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32)
MASK_NORM = float(np.linalg.norm(MASK))

_instead: ContextVar[tuple[Array, Array] | None] = ContextVar("instead", default=None)


@contextmanager
def seen_as(gray: Array, picture: Array) -> Iterator[None]:
    """Make every search of `gray` (this array object only) use a uint8 picture of the same size instead."""
    token = _instead.set((gray, picture))
    try:
        yield
    finally:
        _instead.reset(token)


def to_search(gray: Array) -> tuple[Array, tuple[float, float]]:
    """The picture that a search uses, and its range of grey values."""
    other = _instead.get()
    if other is not None and other[0] is gray:
        return other[1], (0.0, 255.0)
    return gray, grey_range(gray)


def grey_range(gray: Array) -> tuple[float, float]:
    """The darkest and brightest grey value: 0 and 255 for 8 bits, for 16 bits those that occur."""
    if gray.dtype == np.uint8:
        return 0.0, 255.0
    low, high = _percentiles(gray)
    return low, max(high, low + 1.0)


def grey_span(gray: Array) -> float:
    """The difference between the brightest and the darkest grey value of `grey_range`."""
    low, high = grey_range(gray)
    return high - low


def white_level(gray: Array) -> float:
    """The grey value at which a picture saturates: full scale, or for 16 bits the largest value that occurs."""
    return float(gray.max()) if gray.dtype == np.uint16 else 255.0


def to_8_bits(gray: Array) -> Array:
    """The picture in 8 bits for detectors; one of 16 bits, or of weak contrast, is stretched to its own range."""
    picture, limits = to_search(gray)
    if picture is not gray:
        return picture
    return _weak_stretched(gray) if gray.dtype == np.uint8 else _stretched(gray, *limits)


def _weak_stretched(gray: Array) -> Array:
    """An 8-bit picture, stretched if its grey values have a small range that is more than noise."""
    low, high = _percentiles(gray)
    if high - low >= WEAK:
        return gray
    smooth = cv2.GaussianBlur(gray.astype(np.float32), (0, 0), WEAK_BLUR)
    low, high = _percentiles(smooth)
    return gray if high - low < max(SOMETHING * noise(gray), 1.0) else _stretched(smooth, low, high)


def _stretched(picture: Array, low: float, high: float) -> Array:
    scale = 255.0 / (high - low)
    return cv2.convertScaleAbs(np.maximum(picture, low).astype(np.float32), alpha=scale, beta=-low * scale)


def _percentiles(picture: Array) -> tuple[float, float]:
    """The range of grey values without outliers, from a sample of the pixels."""
    stride = max(1, int(np.sqrt(picture.size / SAMPLES)))
    low, high = percentiles(picture[::stride, ::stride], (OUTLIERS, 100 - OUTLIERS))
    return low, high


def noise(gray: Array) -> float:
    """Standard deviation of a picture's noise, grey levels, by the mask of Immerkaer (1996), which ignores gradients.

    The median is used instead of the mean, so that edges have little influence.
    """
    stride = max(1, int(np.sqrt(gray.size / SAMPLES)))
    left = np.abs(cv2.filter2D(gray, cv2.CV_32F, MASK)[::stride, ::stride])
    return float(np.median(left)) / (NORMAL_MEDIAN * MASK_NORM)


def reductions(shape: tuple[int, ...], enlarge: bool = False) -> list[float]:
    """The reduction factors of a picture, the coarsest first, 1 last; then 1/2 to enlarge a small one."""
    factors, pixels = [1.0], shape[0] * shape[1]
    while pixels / factors[0] ** 2 > FIRST_PIXELS:
        factors.insert(0, 2 * factors[0])
    return [*factors, 0.5] if enlarge and pixels <= FIRST_PIXELS else factors


def reduced(picture: Array, factor: float) -> Array:
    """The picture `factor` times smaller; pixel u of it is (u + 0.5) factor - 0.5 of the picture.

    For an integer factor, remaining columns and rows at the right and bottom are cut off, so that this holds exactly.
    """
    if factor == 1:
        return picture
    height, width = (int(n / factor) for n in picture.shape[:2])
    if factor > 1:
        picture = picture[: int(height * factor), : int(width * factor)]
    how = cv2.INTER_AREA if factor > 1 else cv2.INTER_CUBIC
    return cv2.resize(picture, (width, height), interpolation=how)


def as_float(picture: Array, limits: tuple[float, float]) -> Array:
    """The picture in float32, with its limits scaled to 0 and 255."""
    low, high = limits
    values = picture.astype(np.float32)
    return (
        values if (low, high) == (0.0, 255.0) else (values - np.float32(low)) * np.float32(255 / (high - low))
    )
