"""Uneven light: how the white and the black of a board change over a picture, from the fits of its corners.

A slope of the light across a corner's window pulls the corner towards the brighter side: 10 % over a
picture of 640 px and a blur of 1.2 px make about 0.003 px. One corner cannot tell such a slope from a
shift; all of them together can.
"""

from __future__ import annotations

import numpy as np

from camcal.detect.windows import Windows

Array = np.ndarray

LEAST_CORNERS = 12  #: for a quadratic surface; fewer carry a plane, fewer than half of it nothing
ROUNDS = 3  #: of least squares and new weights; the weights of a glare settle in two
HUBER = 2.0  #: median deviations (1.35 sigma, Huber 1964) from which on a corner counts less


def slopes(uv: Array, offset: Array, contrast: Array) -> Array:
    """Slopes (K, 2, 2) of the white (0) and of the black (1) at each corner, grey levels per px.

    Parameters
    ----------
    uv : (K, 2) array
        px.
    offset, contrast : (K,) arrays
        a and |b| of the corners' fits.
    """
    count = len(uv)
    if count < LEAST_CORNERS // 2:
        return np.zeros((count, 2, 2))
    scale = max(float(np.ptp(uv, axis=0).max()), 1e-9)
    x, y = ((uv - uv.mean(0)) / scale).T
    one, zero = np.ones(count), np.zeros(count)
    design, by_x, by_y = [one, x, y], [zero, one, zero], [zero, zero, one]
    if count >= LEAST_CORNERS:
        design += [x * x, x * y, y * y]
        by_x += [2 * x, y, zero]
        by_y += [zero, x, 2 * y]
    levels = np.stack([offset + contrast, offset - contrast], -1)
    surface = np.stack([_robust_fit(np.stack(design, -1), level) for level in levels.T], -1)
    return np.stack([np.stack(d, -1) @ surface / scale for d in (by_x, by_y)], -1)


def _robust_fit(design: Array, values: Array) -> Array:
    """Least squares with Huber's weights, the scale from the median deviation."""
    weighted = design
    for _ in range(ROUNDS):
        solution = np.linalg.solve(weighted.T @ design, weighted.T @ values)
        residual = np.abs(values - design @ solution)
        limit = HUBER * max(float(np.median(residual)), 1e-9)
        weighted = design * np.minimum(1, limit / np.maximum(residual, 1e-12))[:, None]
    return solution


def evened(
    windows: Windows, slope: Array, offset: Array, contrast: Array, limits: tuple[float, float]
) -> Windows:
    """The windows as they would be under the light of their corners.

    Parameters
    ----------
    slope : (K, 2, 2) array
        As `slopes` gives them.
    offset, contrast : (K,) arrays
    limits : (low, high)
        Values at which the picture is cut off; they stay what they are.
    """
    position = np.where(windows.counts[:, None], windows.q, 0)
    white, black = (np.einsum("kc,kcp->kp", slope[:, i], position) for i in (0, 1))
    ink = (offset - contrast)[:, None]
    range_ = 2 * contrast[:, None]
    share = (windows.value - ink - black) / np.maximum(range_ + white - black, 0.2 * range_)
    low, high = limits
    cut_off = (windows.value <= low) | (windows.value >= high)
    value = np.clip(ink + share * range_, low + 1e-3, high - 1e-3)
    value = np.where(cut_off, windows.value, value).astype(np.float32)
    return Windows(windows.origin, windows.q, value, windows.counts, windows.inside)
