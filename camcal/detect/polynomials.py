"""Polynomials of two variables up to the third degree."""

from __future__ import annotations

import numpy as np

Array = np.ndarray

LINEAR, QUADRATIC, CUBIC = 3, 6, 10  #: number of monomials


def monomials(x: Array, y: Array, out: Array, first: int = 0) -> None:
    """Write 1, x, y, x², xy, y², x³, x²y, xy², y³ into `out`, starting at index `first`.

    Parameters
    ----------
    x, y : (..., P) arrays
    out : (..., 10 - first, P) array
    """
    two = [x * x, x * y, y * y]
    three = ((two[0], x), (two[0], y), (two[2], x), (two[2], y))
    for i, term in enumerate([1.0, x, y, *two][first:]):
        out[..., i, :] = term
    for i, (a, b) in enumerate(three, QUADRATIC - first):
        np.multiply(a, b, out=out[..., i, :])
