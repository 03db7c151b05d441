"""The contribution of a rig's calibration to the uncertainty of triangulated points.

A point X that minimises Σ w |r(X, θ)|² moves with the estimates θ of the calibration (implicit function theorem):

    dX/dθ = -(Σ w Aᵀ A)⁻¹ Σ w Aᵀ B,    A = ∂r/∂X,  B = ∂r/∂θ, to first order in r                  (1)

which adds dX/dθ Cov θ (dX/dθ)ᵀ to Cov X. This part is common to all points: more images of a point do not reduce it,
and distances between points are more accurate than their positions.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camcal.geometry import rotations
from camcal.model.pose import Array
from camcal.routes.placed import PlacedCamera
from camcal.routes.triangulate import Images, Triangulated

#: relative to the largest entry of dX/dθ; rounding level above which an undetermined direction moves a point
TOUCHED = 1e-9


def calibration_part(
    found: Triangulated, images: Images, moves: Sequence[Array], covariance: Array, null: Array
) -> Array:
    """Covariances (P, 3, 3) of points due to the calibration alone; NaN for points without a position.

    Parameters
    ----------
    moves : sequence of (Q + 6, F) arrays
        For each camera, d (its parameters, rotation on the left (rad), translation) / d variables.
    covariance : (F, F) array
        Of the variables.
    null : (F, K) array
        Directions that the calibration leaves undetermined; points that move with them have infinite variances.
    """
    count, variables = len(found.xyz), covariance.shape[0]
    normal, right = np.zeros((count, 3, 3)), np.zeros((count, 3, variables))
    weights = np.ones(len(images)) if images.sigma is None else images.sigma**-2.0
    for index, (camera, move) in enumerate(zip(found.cameras, moves, strict=True)):
        own = np.flatnonzero((images.camera == index) & found.used & found.known[images.point])
        by_point, by_variables = _derivatives(camera, found.xyz[images.point[own]], move)
        weighted = by_point * weights[own, None, None]
        np.add.at(normal, images.point[own], np.einsum("nki,nkj->nij", weighted, by_point))
        np.add.at(right, images.point[own], np.einsum("nki,nkf->nif", weighted, by_variables))
    out = np.full((count, 3, 3), np.nan)
    known = found.known
    moved = -np.linalg.solve(normal[known], right[known])
    part = moved @ covariance @ np.swapaxes(moved, 1, 2)
    if null.size:
        lost = np.abs(moved @ null).max(-1) > TOUCHED * np.abs(moved).max((1, 2))[:, None]
        part[np.eye(3, dtype=bool) & lost[:, None, :]] = np.inf
    out[known] = part
    return out


def _derivatives(camera: PlacedCamera, xyz: Array, move: Array) -> tuple[Array, Array]:
    """∂r/∂X (N, 2, 3) and ∂r/∂θ (N, 2, F); x_cam = exp(δ) R X + t moves by δ x (R X)."""
    turned = xyz @ camera.pose.rotation.T
    inside = turned + camera.pose.translation
    _, d_xyz, d_params, _ = camera.camera.lens.jacobians(camera.camera.params, inside)
    own = np.concatenate([d_params, -d_xyz @ rotations.skew(turned), d_xyz], -1)
    return d_xyz @ camera.pose.rotation, own @ move
