"""A frame at its prediction: its equations, and the results of the change tests."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from camcal.track import linear, robust
from camcal.track.linear import Compressed

Array = np.ndarray


@dataclass(slots=True)
class Reading:
    """A frame at its prediction: its equations, the points in them, and its own fit if one was made."""

    equations: Compressed
    keep: Array
    whitening: Any
    innovation: float
    alone: robust.FrameFit | None = None


@dataclass(slots=True)
class Verdict:
    """The results of the change tests for a frame; `innovation` is the lower Cholesky factor of S."""

    nis: float
    dof: int
    score: float
    cusum: float
    test: str | None
    since: int
    innovation: Array


def whitened_rows(design: Array, keep: Array, whitening: Any) -> Array:
    """The kept points of a design, whitened, as the rows of `linear.compress`."""
    rows = design * whitening
    if not keep.all():
        rows = rows[:, :, keep]
    return rows.reshape(len(design), -1)


def near_prediction(design: Array, valid: Array, whitening: Any, factor: Array, limit: float) -> Array:
    """Return which points lie within the gate of their prediction, including the prediction's own uncertainty.

    Parameters
    ----------
    design, valid
        Of `Model.linearise`.
    whitening : float or (N,) array
        One over the noise of the points, 1/px.
    factor : (p, n) array
        Of the covariance of the prediction.
    limit : float
        Largest squared distance, in sigmas.
    """
    p, n = len(factor), design.shape[2]
    spread = (factor.T @ design[:p].reshape(p, -1)).reshape(-1, 2, n)
    su, sv = spread[:, 0], spread[:, 1]
    own = 1.0 / (whitening * whitening)
    uu = np.einsum("ij,ij->j", su, su) + own
    vv = np.einsum("ij,ij->j", sv, sv) + own
    uv = np.einsum("ij,ij->j", su, sv)
    ru, rv = design[p]
    distance = ru * ru * vv - 2 * ru * rv * uv + rv * rv * uu
    return valid & (distance <= limit * (uu * vv - uv * uv))


def innovation_factor(a: Array, factor: Array) -> Array:
    """The lower Cholesky factor of S = A P Aᵀ + I."""
    p = len(a)
    spread = a @ factor[:p]
    s = spread @ spread.T
    s.flat[:: p + 1] += 1.0
    return linear.cholesky(s)
