"""A change of coordinates that makes anisotropic blur, such as motion blur, isotropic.

Blur of covariance S becomes isotropic in the coordinates A q with A = |S|^(1/4) S^(-1/2); straight edges stay straight.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from camcal.detect import edge_model as model
from camcal.detect.fit import Fits
from camcal.detect.windows import FAR, Windows

Array = np.ndarray

ROUND = 1.3  #: largest ratio of the blurs across the two kinds of edges that noise and the lens alone explain


def shape_of(blurs: tuple[float, float], sides: Array) -> Array | None:
    """The matrix A (2, 2), of determinant 1; None if the blur is isotropic within its uncertainty.

    Parameters
    ----------
    blurs : (float, float)
        Standard deviations across the edges along the columns and along the rows, px.
    sides : (K, 2, 2) array
        Steps along columns and rows, px.
    """
    if not 0 < min(blurs) * ROUND < max(blurs):
        return None
    step = np.median(sides, axis=0)
    n = np.stack([[-step[0, 1], step[0, 0]], [-step[1, 1], step[1, 0]]])  # normals of both kinds of edges
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    cosine = n[0] @ n[1]
    # the diagonal of N S Nᵀ holds the squared blurs; its other elements are those of an isotropic blur
    across = np.outer(blurs, blurs) * np.array([[1, cosine], [cosine, 1]])
    inverse = np.linalg.inv(n)
    values, vectors = np.linalg.eigh(inverse @ across @ inverse.T)
    return (vectors * (values.prod() ** 0.25 / np.sqrt(values))) @ vectors.T


def rounded(windows: Windows, sides: Array, shape: Array | None) -> tuple[Windows, Array]:
    """Windows and sides (K, 2, 2) in the coordinates A q; unchanged if A is None."""
    if shape is None:
        return windows, sides
    q = (shape @ np.where(windows.counts[:, None], windows.q, 0)).astype(np.float32)
    return replace(windows, q=np.where(windows.counts[:, None], q, FAR)), sides @ shape.T


def as_seen(fits: Fits, shape: Array | None) -> Fits:
    """Convert fits from the coordinates A q to the picture; their blur is the geometric mean over all directions."""
    if shape is None:
        return fits
    inverse, params = np.linalg.inv(shape), fits.params.copy()
    params[:, :2] = params[:, :2] @ inverse.T
    for i in (model.ANGLE1, model.ANGLE2):
        normal = np.stack([np.cos(params[:, i]), np.sin(params[:, i])], -1) @ shape
        params[:, i] = np.arctan2(normal[:, 1], normal[:, 0])
    return replace(fits, params=params, covariance=inverse @ fits.covariance @ inverse.T)
