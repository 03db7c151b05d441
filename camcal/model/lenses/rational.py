"""A linear fit of a rational radial curve to given points: the start for OpenCV's models on wide lenses."""

from __future__ import annotations

import numpy as np

Array = np.ndarray

#: reweightings by the last denominator; each changes a fisheye curve 20 times less, the fourth by 1e-7 focal lengths
TURNS = 4
#: least denominator that is divided by: a pole among the points is refused in the end (`_grows`)
LEAST_DENOMINATOR = 1e-3
#: radii at which the curve is looked at for a fold or a pole
SAMPLES = 400


def fit_rational(r: Array, rd: Array, numerator: int, denominator: int) -> tuple[Array, Array] | None:
    """k, m of rd = r (1 + k1 r² + k2 r⁴ + ...) / (1 + m1 r² + m2 r⁴ + ...).

    Linear least squares on the equation multiplied by the denominator, divided by the denominator found
    before, so that the error is again that of rd (C. Sanathanan & J. Koerner, 1963).

    Parameters
    ----------
    r, rd : (N,) arrays
    numerator, denominator : int
        Numbers of terms.

    Returns
    -------
    k, m, or None where the curve has a pole or does not grow between 0 and the largest r, and where there are fewer
    points than terms.
    """
    if len(r) < max(numerator + denominator, 1):
        return None
    s = r * r
    powers = s[:, None] ** np.arange(1, max(numerator, denominator, 1) + 1)
    top = np.abs(powers).max(0)  # the columns are scaled by it: r is tan of up to 85 degrees
    weight = np.ones_like(r)
    k, m = np.zeros(numerator), np.zeros(denominator)
    for _ in range(TURNS if denominator else 1):
        lines = np.c_[
            r[:, None] * powers[:, :numerator] / top[:numerator],
            -rd[:, None] * powers[:, :denominator] / top[:denominator],
        ]
        found = np.linalg.lstsq(lines * weight[:, None], (rd - r) * weight, rcond=1e-12)[0]
        k, m = found[:numerator] / top[:numerator], found[numerator:] / top[:denominator]
        below = 1 + powers[:, :denominator] @ m
        weight = 1 / np.maximum(np.abs(below), LEAST_DENOMINATOR)
    return (k, m) if _grows(k, m, float(r.max())) else None


def _grows(k: Array, m: Array, top: float) -> bool:
    r = np.linspace(0, top, SAMPLES)
    s = r * r
    above = 1 + sum(c * s**i for i, c in enumerate(k, 1))
    below = 1 + sum(c * s**i for i, c in enumerate(m, 1))
    return bool((np.asarray(below) > 0).all() and (np.diff(r * above / below) > 0).all())
