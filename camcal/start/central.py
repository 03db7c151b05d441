"""The estimator of Barranco & Medel: the projection matrix with m34 = 1 by a pseudo-inverse.

R. Barranco-Gutiérrez and J. Medel-Juárez, Digital Camera Calibration Analysis Using Perspective Projection
Matrix (2009). `Central` and `Column` carry the paper's names. Numbers in
parentheses are those of docs/closed-forms.md.
"""

from __future__ import annotations

import numpy as np

from camcal.data.observations import Correspondences, View
from camcal.errors import EstimationError
from camcal.geometry import dlt, projective
from camcal.model.pose import Poses
from camcal.start import shape
from camcal.start.base import ClosedForm

Array = np.ndarray

#: |m34| relative to the rms depth of the points: below it the origin lies in the plane of the camera's centre
#: to the precision of 64-bit floats.
NO_DEPTH = 1e-8
#: m34 also counts as 0 below this many of its standard deviations.
SIGNIFICANT = 3.0


def Central(X: Array, Y: Array) -> Array:
    """The matrix C (2N, 11) of the linear system C Column(M) = Column(Y) (2), for m34 = 1.

    Parameters
    ----------
    X : (N, 3) array
        Points of the world.
    Y : (N, 2) array
        Their images, px.

    Returns
    -------
    (2N, 11) array
        Two rows per point, u then v: [x y z 1 0 0 0 0 -ux -uy -uz] and [0 0 0 0 x y z 1 -vx -vy -vz]. The
        columns belong to m11 m12 m13 m14 m21 ... m33: M by rows, without m34.
    """
    x = projective.homogeneous(np.asarray(X, float))
    y = np.asarray(Y, float)
    c = np.zeros((len(x), 2, 11))
    c[:, 0, :4] = c[:, 1, 4:8] = x
    c[:, :, 8:] = -y[:, :, None] * x[:, None, :3]
    return c.reshape(-1, 11)


def Column(M: Array, order: str = "rows") -> Array:
    """The entries of a matrix as one vector.

    The paper's listing of `Column` runs down the columns of its argument, while its `Central` has the
    entries of the projection matrix by rows. With points as rows (`Central` here), Column(Y, "rows") is u1
    v1 u2 v2 ... and Column(M, "rows")[:11] is the vector that `Central` multiplies; the paper's own order is
    "columns".

    Parameters
    ----------
    M : (R, C) array
    order : {"rows", "columns"}

    Raises
    ------
    ValueError
        If `order` is unknown.
    """
    if order not in ("rows", "columns"):
        raise ValueError(f"order '{order}' is neither 'rows' nor 'columns'")
    return np.ravel(M, order="C" if order == "rows" else "F")


def projection_matrix(
    xyz: Array, uv: Array, sigma: Array | None = None, normalise: bool = True
) -> tuple[Array, float]:
    """M (3, 4) with m34 = 1 from Column(M) = C⁺ Column(Y) (3), and the condition number of C.

    The paper's theorem (its eq. 4) forms (CᵀC)⁻¹ Cᵀ, whose condition number is that of C squared; here the
    same least squares solution comes from the singular value decomposition of C.

    Parameters
    ----------
    xyz : (N, 3) array
    uv : (N, 2) array, px
    sigma : (N,) array, optional
        Standard deviations of the image points, px; rows of the system are divided by them.
    normalise : bool
        Scale the columns of C to unit length for the solution; the condition number stays that of C.
    """
    c, y = Central(xyz, uv), Column(uv, "rows")
    if sigma is not None:
        w = np.repeat(1 / sigma, 2)
        c, y = c * w[:, None], y * w
    lengths = np.linalg.norm(c, axis=0) if normalise else np.ones(11)
    lengths[lengths == 0] = 1.0
    m = np.linalg.lstsq(c / lengths, y, rcond=None)[0] / lengths
    singular = np.linalg.svd(c, compute_uv=False)
    return np.append(m, 1.0).reshape(3, 4), float(singular[0] / max(singular[-1], np.finfo(float).tiny))


def estimate(correspondences: Correspondences, skew: bool = False, normalise: bool = True) -> ClosedForm:
    """K and the pose of a single view of points in space. The skew of M is kept in K, regardless of `skew`.

    Raises
    ------
    DataError
        If the view has too few points, or all are collinear.
    EstimationError
        For several views, for points on a plane, and if m34 is near 0.
    """
    view = shape.view_in_space(correspondences, "the estimator 'central'")
    _require_m34(view)
    m, condition = projection_matrix(view.xyz, view.uv, view.sigma, normalise)
    k, rotation, translation, mirrored = projective.decompose(m, view.xyz)
    info = {
        "assumptions": ["m34 = 1"],
        "condition": condition,
        "condition_normal_equations": condition**2,
        "mirrored": mirrored,
        "degenerate": False,
    }
    return ClosedForm("central", k, Poses(rotation[None], translation[None]), m, info)


def _require_m34(view: View) -> None:
    """Raise an error if the world's origin has zero depth, since M cannot be scaled to m34 = 1 then.

    m34 comes from the homogeneous solution, its standard deviation from the residuals of that. Both are
    compared with the root mean square of the points' m3·(x, y, z, 1): these are depths, so the ratios depend
    neither on the unit nor on the scale of M.
    """
    weights = None if view.sigma is None else view.sigma[None] ** -2.0
    a, t_xyz, _ = dlt.system(view.xyz[None], view.uv[None], weights)
    _, singular, vt = np.linalg.svd(
        np.concatenate([a[0], np.zeros((max(12 - a.shape[1], 0), 12))]), full_matrices=False
    )
    # normalised points have depths m3·T x, so m34 of the data is m3·T[:, 3]
    to_m34 = np.concatenate([np.zeros(8), t_xyz[0, :, 3]])
    depths = projective.homogeneous(view.xyz) @ t_xyz[0].T @ vt[11, 8:]
    size = np.sqrt((depths**2).mean())
    ratio = abs(vt[11] @ to_m34) / size
    noise = singular[11] / np.sqrt(max(a.shape[1] - 11, 1))
    sigma = (
        noise * np.linalg.norm((vt[:11] @ to_m34) / np.maximum(singular[:11], np.finfo(float).tiny)) / size
    )
    if ratio < max(NO_DEPTH, SIGNIFICANT * sigma):
        raise EstimationError(
            f"m34 is near 0 ({ratio:.1e} ± {sigma:.1e} of the points' depth): the depth of the world "
            f"origin is near 0, and a matrix scaled to m34 = 1 would be dominated by noise.",
            "Move the world origin, or use the closed form 'dlt'.",
        )
