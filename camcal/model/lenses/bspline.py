"""Uniform cubic B-splines: which four basis functions count at a point, with what weights."""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def locate(t: Array, intervals: int) -> tuple[Array, Array]:
    """The interval (0 to intervals - 1) of each t and the place within it; the outer ones reach on."""
    cell = np.clip(np.nan_to_num(np.floor(t)), 0, intervals - 1).astype(int)
    return cell, t - cell


def weights(f: Array) -> tuple[Array, Array, Array, Array]:
    """Values of the four basis functions at the place f in [0, 1] of an interval (de Boor 1978, ch. IX)."""
    g = 1 - f
    f2, g2 = f * f, g * g
    return g2 * g / 6, (4 + f2 * (3 * f - 6)) / 6, (4 + g2 * (3 * g - 6)) / 6, f2 * f / 6


def slopes(f: Array) -> tuple[Array, Array, Array, Array]:
    """Their derivatives with respect to f."""
    g = 1 - f
    return -g * g / 2, f * (3 * f - 4) / 2, -g * (3 * g - 4) / 2, f * f / 2
