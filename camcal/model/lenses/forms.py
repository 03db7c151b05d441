"""Descriptions of a camera that lens models provide: its form for cv2, shared terms, and sparse derivatives."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from camcal.records import dataclass

Array = np.ndarray
Values = dict[str, float]


@dataclass(frozen=True)
class OpenCVForm:
    """The same camera for cv2: the function family that accepts it and the coefficients in cv2's order.

    `function` is the calibration function (`calibrateCamera`, `fisheye.calibrate`, `omnidir.calibrate`);
    `flags` are the names of its flags.
    """

    function: str
    distortion: Array
    flags: tuple[str, ...] = ()
    xi: float | None = None


@dataclass(frozen=True)
class Reading:
    """A camera in terms that models share, so that one model can represent another's camera exactly.

    Attributes
    ----------
    terms : mapping of str -> float
        Values by the terms of `Lens.terms`, and fx, fy, cx, cy, skew. A term that is left out has no effect.
    curve : str
        What is left with no term: `perspective` (R = tan θ) or `equidistant` (R = θ).
    """

    terms: Mapping[str, float]
    curve: str = "perspective"


@dataclass(frozen=True)
class LocalRows:
    """Derivatives with respect to the `local` last coefficients; each point depends on K in each of two halves.

    With h = `local` / 2, d(u, v) / d(coefficient c of half i) at point n is factors[i, :, n] · basis[n, m] where
    c = columns[n, m], and 0 for the others.

    Attributes
    ----------
    columns : (N, K) int array, 0 to h - 1
    basis : (N, K) array
    factors : (2, 2, N) array, px: half, (u, v), point
    """

    columns: Array
    basis: Array
    factors: Array
