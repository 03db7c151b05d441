"""Projection matrices of many views at once, by the direct linear transformation.

Abdel-Aziz & Karara (1971); in homogeneous form with Hartley's normalisation as in Hartley & Zisserman,
section 7.1.
"""

from __future__ import annotations

import numpy as np

from camcal.geometry import projective

Array = np.ndarray


def dlt(xyz: Array, uv: Array, weights: Array | None = None) -> Array:
    """The projection matrix M (3, 4) of points xyz (N, 3) and images uv (N, 2), of unit norm.

    Positive depths m3·(x, y, z, 1) of the points' centroid fix the sign. N >= 6, not all on a plane.
    """
    w = None if weights is None else weights[None]
    return projection_matrices(xyz[None], uv[None], w)[0]


def projection_matrices(xyz: Array, uv: Array, weights: Array | None = None) -> Array:
    """Projection matrices (V, 3, 4) of views with the same number of points; see `solve`."""
    return solve(xyz, uv, weights)[0]


def solve(xyz: Array, uv: Array, weights: Array | None = None, normalise: bool = True) -> tuple[Array, Array]:
    """Minimise |A m| with |m| = 1 on normalised coordinates (docs/closed-forms.md, eq. 4).

    Hartley & Zisserman, eq. 7.2 and algorithm 7.1.

    Parameters
    ----------
    xyz : (V, N, 3) array
    uv : (V, N, 2) array, px
    weights : (V, N) array, optional
        1 / sigma²
    normalise : bool
        See `system`.

    Returns
    -------
    matrices : (V, 3, 4) array
        Of unit norm, the centroid of the points at a positive depth.
    singular : (V, 12) array
        Singular values of A, descending; the last but one is near 0 where the points leave more than one M.
    """
    a, t_xyz, t_uv = system(xyz, uv, weights, normalise)
    # zero rows where there are fewer equations than unknowns, so that all 12 right singular vectors come out
    unknowns = a.shape[2]
    padded = np.concatenate([a, np.zeros((len(a), max(unknowns - a.shape[1], 0), unknowns))], 1)
    _, singular, vt = np.linalg.svd(padded, full_matrices=False)
    m = vt[:, -1].reshape(-1, 3, 4)
    depth = np.einsum("vk,vk->v", m[:, 2], (t_xyz @ _centroid(xyz)[..., None])[..., 0])
    m = m * np.where(depth < 0, -1.0, 1.0)[:, None, None]
    m = np.linalg.inv(t_uv) @ m @ t_xyz
    return m / np.linalg.norm(m, axis=(1, 2), keepdims=True), singular


def _centroid(xyz: Array) -> Array:
    """Homogeneous centroids (V, 4)."""
    return projective.homogeneous(xyz.mean(1))


def system(
    xyz: Array, uv: Array, weights: Array | None = None, normalise: bool = True
) -> tuple[Array, Array, Array]:
    """The equations A m = 0 in normalised coordinates, or in the data's own where `normalise` is False.

    Returns
    -------
    a : (V, 2N, 12) array
        Rows scaled by the roots of the weights over their mean; unknowns m by rows.
    t_xyz : (V, 4, 4) array
    t_uv : (V, 3, 3) array
        The normalisations: the matrix of the data is t_uv⁻¹ M t_xyz.
    """
    if normalise:
        t_xyz, t_uv = projective.normalisation(xyz), projective.normalisation(uv)
    else:
        t_xyz, t_uv = (np.broadcast_to(np.eye(n), (len(xyz), n, n)) for n in (4, 3))
    x = projective.homogeneous(xyz) @ np.swapaxes(t_xyz, 1, 2)
    y = (projective.homogeneous(uv) @ np.swapaxes(t_uv, 1, 2))[..., :2]
    views, count = x.shape[:2]
    a = np.zeros((views, count, 2, 3, 4))
    a[:, :, 0, 0] = a[:, :, 1, 1] = x
    a[:, :, :, 2] = -y[..., None] * x[:, :, None]
    if weights is not None:
        a *= np.sqrt(weights / weights.mean(-1, keepdims=True))[..., None, None, None]
    return a.reshape(views, 2 * count, 12), t_xyz, t_uv
