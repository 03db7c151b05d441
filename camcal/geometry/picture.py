"""The area of a picture in pixel coordinates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

Array = np.ndarray

#: px that the picture extends beyond the centres of its outermost pixels, which have whole numbers as in OpenCV
BORDER = 0.5


def in_picture(uv: Array, size: Sequence[int] | Array, margin: Array | float = 0.0) -> Array:
    """Return which pixels (..., 2) lie within a picture; the border is inside, NaN is not.

    Parameters
    ----------
    uv : (..., 2) array
        Pixels, the centre of the upper left one is (0, 0).
    size : (2,)
        Width and height, px.
    margin : (2,) array or float
        Px that the area is smaller on each side; larger where negative.
    """
    with np.errstate(invalid="ignore"):
        low, high = margin - BORDER, np.asarray(size) - BORDER - margin
        return np.asarray(((uv >= low) & (uv <= high)).all(-1))
