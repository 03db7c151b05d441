"""Polynomials of two variables up to the fourth degree."""

from __future__ import annotations

import numpy as np

Array = np.ndarray

LINEAR, QUADRATIC, CUBIC, QUARTIC = 3, 6, 10, 15  #: number of monomials


def monomials(x: Array, y: Array, out: Array) -> None:
    """Write 1, x, y, x², xy, y², x³, x²y, xy², y³, x⁴, x³y, x²y², xy³, y⁴ into `out`.

    Parameters
    ----------
    x, y : (..., P) arrays
    out : (..., 15, P) array
    """
    xx, xy, yy = x * x, x * y, y * y
    for i, term in enumerate([1.0, x, y, xx, xy, yy]):
        out[..., i, :] = term
    three = ((xx, x), (xx, y), (yy, x), (yy, y))
    four = ((xx, xx), (xx, xy), (xy, xy), (xy, yy), (yy, yy))
    for i, (a, b) in enumerate((*three, *four), QUADRATIC):
        np.multiply(a, b, out=out[..., i, :])
