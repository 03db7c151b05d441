"""Uniform cubic B-splines: the four basis functions that are non-zero at a point, and their weights."""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def locate(t: Array, intervals: int) -> tuple[Array, Array]:
    """The interval (0 to intervals - 1) of each t and the position within it; the outer intervals extend beyond
    the ends.
    """
    cell = np.clip(np.nan_to_num(np.floor(t)), 0, intervals - 1).astype(int)
    return cell, t - cell


def weights(f: Array) -> tuple[Array, Array, Array, Array]:
    """Values of the four basis functions at the position f in [0, 1] of an interval (de Boor 1978, ch. IX)."""
    g = 1 - f
    f2, g2 = f * f, g * g
    return g2 * g / 6, (4 + f2 * (3 * f - 6)) / 6, (4 + g2 * (3 * g - 6)) / 6, f2 * f / 6


def slopes(f: Array) -> tuple[Array, Array, Array, Array]:
    """Their derivatives with respect to f."""
    g = 1 - f
    return -g * g / 2, f * (3 * f - 4) / 2, -g * (3 * g - 4) / 2, f * f / 2


def refined(c: Array, times: int) -> Array:
    """Coefficients of the same spline with `times` as many intervals: (n + 3, ...) -> (times n + 3, ...).

    Each new coefficient is the blossom of a piece at three neighbouring knots (Ramshaw 1989), found here from the
    piece's values at four places, which determine a cubic.
    """
    intervals = len(c) - 3
    f = np.arange(4) / 3
    fine = np.arange(times * intervals)[:, None] + f  # places, in the new intervals
    cell, place = locate(fine / times, intervals)
    values = sum(w[..., None] * c.reshape(len(c), -1)[cell + m] for m, w in enumerate(weights(place)))
    pieces = np.linalg.solve(np.stack(weights(f), 1), values)  # the four coefficients of each new interval
    out = np.concatenate([pieces[:, 0], pieces[-1, 1:]])
    return out.reshape(-1, *c.shape[1:])
