"""One view of a plane: which of the principal point's coordinates it determines.

Its homography gives two equations, for the focal lengths; only a strongly distorting lens shows its centre as well.
A fit with an undetermined principal point free goes anywhere, to several picture widths outside.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from camcal.data.observations import Observations
from camcal.geometry import rotations
from camcal.least_squares.blocks import unit_eigen
from camcal.model.camera import Camera
from camcal.model.pose import Array, Poses
from camcal.routes import assumed_centre
from camcal.solve.parameters import free_matrix
from camcal.start import shape

#: eigenvalues of the scaled normal equations below this fraction of the largest count as 0: rounding of exact data
ROUNDING = 1e-12


def undetermined_centre(
    camera: Camera, poses: Poses, observations: Observations, fix: Mapping[str, float | None]
) -> tuple[str, ...]:
    """The free coordinates of the principal point that a single view of a plane leaves undetermined; () for others."""
    names = tuple(n for n in assumed_centre.PIXELS if n in camera.lens.names and n not in fix)
    if not names or shape.distinct(observations.views) > 1 or not shape.check(observations).planar.all():
        return ()
    if camera.image_size is None:
        return names
    sigmas = _sigmas(camera, poses, observations, free_matrix(camera.lens, camera.params, dict(fix)))
    return assumed_centre.undetermined(camera, sigmas, names)


def _sigmas(camera: Camera, poses: Poses, observations: Observations, free: Array) -> Array:
    """Standard deviations (P,) of the parameters by the normal equations, NaN where undetermined."""
    turned = observations.xyz @ poses.rotations[0].T
    projected, d_xyz, d_params, valid = camera.lens.jacobians(camera.params, turned + poses.translations[0])
    jacobian = np.concatenate([d_params @ free, -d_xyz @ rotations.skew(turned), d_xyz], 2)[valid]
    residual = (projected - observations.uv)[valid]
    normal = np.einsum("nij,nik->jk", jacobian, jacobian)
    values, vectors, units = unit_eigen(normal)
    if not values[0] > ROUNDING * values[-1]:
        return np.full(len(free), np.nan)
    inverse = (vectors / values) @ vectors.T / units
    count = free.shape[1]
    freedom = max(residual.size - len(normal), 1)
    variance = float(np.square(residual).sum()) / freedom
    return np.asarray(np.sqrt(variance * np.diagonal(free @ inverse[:count, :count] @ free.T)))
