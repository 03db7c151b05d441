"""Raw pictures of a colour sensor, in which each pixel has recorded only one colour (a Bayer mosaic)."""

from __future__ import annotations

import numpy as np

from camcal.geometry.numbers import median

Array = np.ndarray

BLOCK = 16  #: px; side of the blocks in which the four phases of the mosaic are compared
#: least difference between the levels of the phases. Without a mosaic the medians over all blocks differ by less
#: than 0.01; red or blue against green differ by 0.1 to 0.6 in daylight and under lamps
LEAST_DIFFERENCE = 0.06
DARK = 0.05  #: of full scale; darker blocks do not reveal the levels
LEAST_BLOCKS = 64  #: least number of blocks over which the medians are taken


def levels(gray: Array) -> Array | None:
    """The level (2, 2) of each phase of the mosaic, 1 on average; None if the picture is not a mosaic.

    Parameters
    ----------
    gray : (height, width) uint8 or uint16 array
    """
    rows, columns = (n // BLOCK for n in gray.shape)
    if rows * columns < LEAST_BLOCKS:
        return None
    cut = gray[: rows * BLOCK, : columns * BLOCK]
    half = BLOCK // 2
    of_lines = cut.reshape(rows, half, 2, -1).sum(1, dtype=np.uint32)  # whole lines first: contiguous
    phases = of_lines.reshape(rows, 2, columns, half, 2).sum(3) / half**2  # (rows, 2, columns, 2)
    mean = phases.mean((1, 3))
    bright = mean > DARK * np.iinfo(gray.dtype).max
    if bright.sum() < LEAST_BLOCKS:
        return None
    ratio = phases.transpose(0, 2, 1, 3)[bright] / mean[bright][:, None, None]
    found = median(ratio, 0)
    return found if np.ptp(found) > LEAST_DIFFERENCE else None


def evened(gray: Array, phases: Array) -> Array:
    """The picture with its four phases scaled to one level, which shows a grey target at full resolution.

    Demosaicing would interpolate across the edges whose positions are measured.
    """
    scale = np.tile(phases.min() / phases, tuple(-(-n // 2) for n in gray.shape))[
        : gray.shape[0], : gray.shape[1]
    ]
    return np.rint(gray * scale).astype(gray.dtype)
