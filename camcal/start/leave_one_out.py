"""Prediction error of each point of a least-squares fit from the other points."""

from __future__ import annotations

import numpy as np

Array = np.ndarray

#: determinant of I - H_ii below which the fit follows a point exactly
FOLLOWED = 1e-9


def rms_point(residual: Array, jacobian: Array, roots: Array) -> float:
    """rms_point with each point predicted without it, to first order (I - H_ii)⁻¹ r_i with H = J J⁺; inf for
    points that nothing else determines.

    Parameters
    ----------
    residual : (2N,) array, times the roots of the weights
    jacobian : (2N, P) array, times them
    roots : (N,) array
    """
    basis = np.linalg.qr(jacobian)[0].reshape(len(roots), 2, -1)
    own = np.eye(2) - basis @ np.swapaxes(basis, 1, 2)
    # a point that the fit follows exactly is not predicted by the others
    safe = np.linalg.det(own) > FOLLOWED
    alone = np.full((len(roots), 2), np.inf)
    alone[safe] = np.linalg.solve(own[safe], residual.reshape(-1, 2)[safe][..., None])[..., 0]
    return float(np.sqrt(np.square(alone / roots[:, None]).sum(1).mean()))
