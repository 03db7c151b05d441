"""Uncertainty from the scatter between lines: the change of the lens when each line is left out.

Curves that a program finds in a picture may contain edges joined by mistake. Points of such a curve share its error, so
that residuals of points do not show how uncertain the lens is.
"""

from __future__ import annotations

import numpy as np

from camcal.least_squares.distributions import f_bound
from camcal.least_squares.scales import NORMAL_95
from camcal.model.pose import Array
from camcal.routes.line_geometry import Lines, slopes, tangents

#: 1 - leverage of a line below which it alone determines a direction, and no other line can contradict it
ALONE = 1e-9


def with_scatter(
    lines: Lines, at: tuple[Array, Array, Array], n: Array, weight: Array, basis: Array, variance: float
) -> Array:
    """The covariance (P, P) by the scatter between lines, in directions in which it exceeds `variance` B Bᵀ.

    Leaving out a line changes the parameters by B (I - H)⁻¹ s, with its score s and its leverage H (the jackknife:
    MacKinnon & White, Some heteroskedasticity-consistent covariance matrix estimators, Journal of Econometrics 29,
    1985, HC3). The sum of squares of the changes has as many values as there are lines: 1.96 standard deviations are
    those of Student's t.

    Parameters
    ----------
    at : as of `line_geometry.line_rays`, of the lens found
    n : (N, 3) array
        Unit normal of the plane of each point's line.
    weight : (N,) array
        Of the points.
    basis : (P, K) array
        B, in which the normal matrix is the identity.
    """
    count = len(lines)
    if count < 2 or not basis.shape[1]:
        return np.asarray(variance * basis @ basis.T)
    root = np.sqrt(weight) / slopes(at, n)
    moves = root[:, None] * (np.einsum("ni,nip->np", n, at[2]) @ basis)
    own = root[:, None] * np.einsum("nik,ni->nk", tangents(n), at[0])
    residual = root * (n * at[0]).sum(1)
    changes = changes_without(lines, moves, own, residual)
    wider = f_bound(0.05, 1, count - 1) / NORMAL_95**2
    spread, directions = np.linalg.eigh(wider * changes.T @ changes)
    out = basis @ directions
    return np.asarray((out * np.maximum(spread, variance)) @ out.T)


def changes_without(lines: Lines, moves: Array, own: Array, residual: Array) -> Array:
    """(I - H)⁻¹ s (L, K) of each line, by the derivatives of the residuals (N,) by B (N, K) and by normals (N, 2)."""
    changes = np.empty((len(lines), moves.shape[1]))
    for line in range(len(lines)):
        rows = lines.line == line
        # beside the normal of the line itself
        alone = moves[rows] - own[rows] @ np.linalg.lstsq(own[rows], moves[rows], rcond=None)[0]
        values, vectors = np.linalg.eigh(alone.T @ alone)
        left = np.where(1 - values > ALONE, 1 - values, np.inf)
        changes[line] = vectors @ (vectors.T @ (alone.T @ residual[rows]) / left)
    return changes
