"""Roots of polynomials and eigenvalues that are real up to rounding."""

from __future__ import annotations

import numpy as np

Array = np.ndarray

#: of 1 + |root|; rounding, 1e-16, splits a double root into a complex pair that is its square root, 1e-8, apart
ROUNDING = 1e-6


def are_real(roots: Array) -> Array:
    """A mask of the complex numbers (any shape) that are finite and real to within `ROUNDING`."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.isfinite(roots) & (np.abs(roots.imag) < ROUNDING * (1 + np.abs(roots.real))))
