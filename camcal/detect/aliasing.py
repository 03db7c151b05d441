"""Pictures without anti-aliasing, as simple renderers produce them: each pixel is black or white."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from camcal.detect.fit import Fits
from camcal.detect.part import Picture, white
from camcal.detect.windows import Windows
from camcal.least_squares.scales import UNIFORM

Array = np.ndarray

#: least share of a window's pixels with grey values between black and white. Averaging over the area of a pixel alone
#: makes an edge 1 px wide, in the 4 to 5 px band of a first fit; a smaller share means that there is no anti-aliasing
BETWEEN = 0.05


def is_aliased(picture: Picture, windows: Windows) -> bool:
    """Return whether hardly any pixel of the windows lies between black and white."""
    between = windows.counts & (windows.value > 0) & (windows.value < white(picture))
    return bool(between.sum() < BETWEEN * windows.counts.sum())


def grey_limits(picture: Picture, windows: Windows) -> tuple[float, float]:
    """Grey values at which a picture is clipped: pixels there are at least as dark or as bright.

    Without anti-aliasing, black and white themselves are exact, not clipped, and the limits lie beyond them.
    """
    high = white(picture)
    return (-1.0, high + 1.0) if is_aliased(picture, windows) else (0.0, high)


def with_sampling(fits: Fits, axes: Array) -> Fits:
    """Fits of an aliased picture, with the uncertainty of its edges added to the covariance.

    An edge is equally likely anywhere between two rows of pixels; one that crosses n rows or columns moves by
    1 / (n + 1) px before a pixel changes.

    Parameters
    ----------
    fits : Fits
    axes : (K, 2, 2) array
        Half-widths of the windows along columns and rows, px.
    """
    length = np.linalg.norm(axes, axis=2, keepdims=True)
    normal = (
        np.stack([-axes[:, ::-1, 1], axes[:, ::-1, 0]], -1) / length[:, ::-1]
    )  # of the edges along rows, columns
    crossed = 2 * np.abs(axes[:, ::-1]).min(2)
    inverse = np.linalg.inv(normal)
    across = inverse * (UNIFORM / (1 + crossed))[:, None, :]
    return replace(fits, covariance=fits.covariance + across @ across.transpose(0, 2, 1))
