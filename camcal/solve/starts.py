"""Starts of the refinement if a pinhole camera is too inaccurate: wide-angle lenses, and larger models.

A closed form that assumes a pinhole camera fails beyond some 120 degrees. The radial alignment constraint then gives
poses and an approximate lens of any field of view, to whose rays the requested model is fitted. For a weakly determined
camera, the refinement starts from several principal points, each with its own poses.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import product

import numpy as np

from camcal.data.observations import Observations
from camcal.errors import DataError, EstimationError
from camcal.model.camera import Camera
from camcal.model.lenses import make
from camcal.model.lenses.base import Lens
from camcal.model.lenses.containment import embed
from camcal.model.lenses.regress import minima, regress
from camcal.model.pose import Poses
from camcal.solve.calibration import Calibration
from camcal.solve.parameters import ASPECT, apply_fixed
from camcal.solve.refine import refine, residuals
from camcal.start import assumptions
from camcal.start.known_pose import start_poses
from camcal.start.radial import RadialStart

#: a pinhole start with a larger rms than this fraction of the image's half diagonal is too inaccurate:
#: at 120 degrees it is 1 %, at 150 degrees 4 %
POOR_START = 0.02
#: a refinement with a larger median error than this fraction, or that does not converge, may be in a wrong minimum,
#: where it is 1 % or more; with too small a model of a real lens it is .05 to .1 %
POOR_END = 0.002
#: positions of starts in the joint interval of the principal point, in standard deviations: half-way and at the 95 %
#: end
REACHES = (1.0, 2.0)
#: fraction of a model's angular limit, and largest angle, rad, to which views are moved into its domain
CONES = ((0.98, np.deg2rad(88)), (0.9, np.deg2rad(84)))
#: the lens used instead of one that cannot represent all rays of the approximate start
GENERAL = "kb4"


def poor(rms_point: float, observations: Observations) -> bool:
    """Return whether a start is too far from the data for refinement."""
    return not rms_point <= POOR_START * _half_diagonal(observations)


def doubtful(calibration: Calibration) -> bool:
    """Return whether a fit may have ended in a wrong local minimum: most of its errors are larger than `POOR_END`."""
    if not calibration.fit.converged:
        return True
    r, bound = calibration.used_residuals, POOR_END * _half_diagonal(calibration.observations)
    # tested for every attempt; a median takes longer
    small = np.count_nonzero(np.einsum("ij,ij->i", r, r) <= bound**2)
    return bool(2 * small < len(r))


def _half_diagonal(observations: Observations) -> float:
    if observations.image_size is not None:
        return math.hypot(*observations.image_size) / 2
    return float(1 / assumptions.unit_coordinates(observations)[0][0, 0])


def from_radial(
    lens: Lens, rough: RadialStart, observations: Observations, fix: Mapping[str, float | None]
) -> list[tuple[Camera, Poses]]:
    """Starts for a model from the solution of the radial alignment constraint.

    For a model that cannot represent the rays farthest from the axis, views are moved away from the
    camera until it can.

    Parameters
    ----------
    lens : Lens
    rough : RadialStart
    observations : Observations
        The rows to use.
    fix : mapping
        As in `How`; a parameter without a value is held at its value for a lens without distortion.

    Raises
    ------
    EstimationError
        If the substitute lens cannot be fitted.
    """
    camera = regressed(lens, rough.camera, observations, fix)
    if _holds(camera, rough.poses, observations):
        return [(camera, rough.poses)]
    general = refine(regressed(make(GENERAL), rough.camera, observations), rough.poses, observations)
    camera = regressed(lens, general.camera, observations, fix)
    limit = lens.limit_angle(camera.params)
    tried = [
        general.poses,
        *(_pushed(general.poses, observations, min(part * limit, top)) for part, top in CONES),
    ]
    return [(camera, p) for p in tried if _holds(camera, p, observations)]


def _pushed(poses: Poses, observations: Observations, angle: float) -> Poses:
    """The poses, moved away along the axis until no point is at a larger angle from it, rad."""
    moved = poses.translations.copy()
    for view, r, t in zip(observations.views, poses.rotations, moved, strict=True):
        x, y, z = (view.xyz @ r.T + t).T
        t[2] += max(float((np.hypot(x, y) / np.tan(angle) - z).max()), 0.0)
    return Poses(poses.rotations, moved)


def regressed(
    lens: Lens,
    camera: Camera,
    observations: Observations,
    fix: Mapping[str, float | None] | None = None,
) -> Camera:
    """The camera of a model that is nearest to another camera at the observed pixels."""
    uv, size = observations.uv, observations.image_size
    rays = camera.unproject(uv)
    seen = np.isfinite(rays).all(1)
    params = regress(lens, rays[seen], uv[seen], size).params
    named = [n for n in fix or {} if n != ASPECT]
    if fix:
        plain = lens.from_matrix(lens.matrix(params))
        for name in named:
            params[lens.index(name)] = plain[lens.index(name)]
        params = apply_fixed(lens, params, fix)
        held = (*lens.default_fixed, *named)
        params = regress(lens, rays[seen], uv[seen], size, hold=held, start=params).params
        params = apply_fixed(lens, params, fix)
    return Camera(lens, params, size)


def _holds(camera: Camera, poses: Poses, observations: Observations) -> bool:
    """Return whether all points project; otherwise a refinement cannot start."""
    return bool(np.isfinite(residuals(camera, poses, observations)).all())


def adopted(lens: Lens, inner: Calibration, fix: Mapping[str, float | None]) -> tuple[Camera, Poses]:
    """The fit of a model that `lens` contains, as a start."""
    held = embed(lens, inner.camera.lens, inner.camera.params)
    assert held is not None, f"{lens} does not contain {inner.camera.lens}"
    params = apply_fixed(lens, held, fix)
    return Camera(lens, params, inner.camera.image_size), inner.poses


def about(
    calibration: Calibration, sigmas: Mapping[str, float], fix: Mapping[str, float | None]
) -> list[tuple[Camera, Poses]]:
    """Starts with principal points across their joint interval, without distortion, with poses recomputed.

    Parameters
    ----------
    calibration : Calibration
    sigmas : mapping
        Of each parameter, px; one that is not finite, or exceeds the image, is replaced by half of its diagonal.
    fix : mapping
        As in `How`.
    """
    lens, data = calibration.camera.lens, calibration.observations.kept()
    most = _half_diagonal(data)
    reach = [min(sigmas[n], most) if n in sigmas else 0.0 for n in ("cx", "cy")]
    found = []
    steps = [(part * i, part * j) for part in REACHES for i, j in product((-1, 0, 1), repeat=2) if i or j]
    for across, down in [(0.0, 0.0), *steps]:
        matrix = calibration.camera.matrix.copy()
        matrix[:2, 2] += across * reach[0], down * reach[1]
        params = apply_fixed(lens, lens.from_matrix(matrix), fix)
        camera = Camera(lens, params, calibration.camera.image_size)
        try:
            found.append((camera, start_poses(camera, data.views)))
        except (DataError, EstimationError):
            continue  # too few rays lie ahead of such a camera
    return found


def other_minima(calibration: Calibration) -> list[Camera]:
    """Cameras of the model that fit the rays nearly as well, and may fit the points better."""
    lens, camera, used = calibration.camera.lens, calibration.camera, calibration.used
    uv = calibration.observations.uv[used]
    rays = camera.unproject(uv)
    seen = np.isfinite(rays).all(1)
    fixed = ~np.any(calibration.free, axis=1)
    held = [n for n, hold in zip(lens.names, fixed, strict=True) if hold]
    found = minima(lens, rays[seen], uv[seen], camera.image_size, held)
    return [Camera(lens, p, camera.image_size) for p in found]


def has(lens: Lens, name: str) -> bool:
    """Return whether `--fix NAME` applies to a lens."""
    return name == ASPECT or name in lens.names
