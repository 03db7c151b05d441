"""Tsai's two stages: radial alignment for the first rows of the poses, then focal length, distortion and depth.

R. Tsai, A versatile camera calibration technique for high-accuracy 3D machine vision metrology using off-the-shelf
TV cameras and lenses, IEEE Journal of Robotics and Automation 3 (1987), section II. The image's centre is assumed
to be the distortion centre, and pixels to be square.

Stage 1: the direction from the centre to an image point is that of (x, y) in the camera's frame, whatever the
focal length and the radial distortion, which gives r1, r2, t1, t2 of each view (for planes up to the sign of one root,
which stage 2 determines). Stage 2: with ρ the distance from the centre and r = |(x, y)|,

    (f + a ρ²) r - ρ t3 = ρ (r3 · X)                                                                     (1)

is linear in f, a and the t3 of all views. Tsai starts with a = 0 and iterates with his κ1; a = -f κ1 to first
order.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from camcal.data.observations import Observations
from camcal.errors import EstimationError
from camcal.geometry import projective
from camcal.model.camera import Camera
from camcal.model.lenses import make
from camcal.model.pose import Poses
from camcal.start import assumptions, pose, shape
from camcal.start.base import ClosedForm, scaled
from camcal.start.mirrored import mirrored_error
from camcal.start.radial import UNCERTAIN, depths, partial_pose, prepared, turned

#: degrees; planes tilted by less are reported as parallel to the picture if the focal length is undetermined
FRONTO_PARALLEL = 10.0


def estimate(correspondences: Observations, skew: bool = False, normalise: bool = True) -> ClosedForm:
    """K with square pixels and the image centre, and the poses, from one or more views of planes or points in space.

    Raises
    ------
    DataError
        If a view has too few points, or points in space and their images are mirrored.
    EstimationError
        If f and the distances cannot be separated: planes parallel to the picture (fronto-parallel).
    """
    form = shape.check(correspondences)
    unit, where = assumptions.unit_coordinates(correspondences)
    half_diagonal = 1 / unit[0, 0]
    centre = -unit[:2, 2] * half_diagonal
    views, scales = prepared(correspondences, form, centre, half_diagonal)
    partial = [partial_pose(v, np.zeros(2)) for v in views]
    lens = depths(views, partial, np.zeros(2), (0, 2))
    rotation = np.stack([turned(r, s) for (r, _), s in zip(partial, lens.signs, strict=True)])
    if lens.coefficients[0] < 0 and lens.uncertainty < UNCERTAIN and not form.planar.any():
        raise mirrored_error(
            -rotation[0]
        )  # r1 and r2 are the directions of u and v, r3 that of the reflection
    if not (lens.coefficients[0] > 0 and lens.uncertainty < UNCERTAIN):
        raise _undetermined(rotation, bool(form.planar.all()), lens.uncertainty)
    focal = float(lens.coefficients[0] * half_diagonal)
    translation = np.c_[np.stack([t for _, t in partial]), lens.t3] * scales[:, None]
    poses = pose.from_plane(Poses(rotation, translation), form.origins, form.axes)
    k = np.array([[focal, 0, centre[0]], [0, focal, centre[1]], [0, 0, 1]])
    info: dict[str, Any] = {
        "assumptions": ["square pixels", f"the principal point at {where}"],
        "kappa1": float(-lens.coefficients[1] / lens.coefficients[0] / half_diagonal**2),
        "focal_uncertainty": lens.uncertainty,
        "condition": lens.condition,
        "mirrored": False,
        "degenerate": False,
    }
    matrix = None
    if len(correspondences) == 1:
        matrix = scaled(projective.compose(k, poses.rotations[0], poses.translations[0]))
    model = make("division:1")  # (1) in focal lengths: (r, z) ~ (R, 1 + (a f) R²)
    params = model.from_matrix(k)
    params[4] = lens.coefficients[0] * lens.coefficients[1]
    return ClosedForm("tsai", k, poses, matrix, info, Camera(model, params, correspondences.image_size))


def _undetermined(rotation: np.ndarray, planar: bool, uncertainty: float) -> EstimationError:
    tilt = np.degrees(np.arccos(np.clip(np.abs(rotation[:, 2, 2]), 0, 1)))
    what = "the points are too few or too noisy"
    if planar:
        what = f"the planes are tilted by at most {tilt.max():.1f} degrees"
        if tilt.max() < FRONTO_PARALLEL:
            what += ", almost parallel to the image plane (fronto-parallel)"
    known = f"{uncertainty:.0%}" if np.isfinite(uncertainty) else "nothing"
    return EstimationError(
        f"radial alignment cannot separate the focal length from the distance: {what}; the focal length "
        f"would be known to {known}; {UNCERTAIN:.0%} is needed.",
        "Tilt the target by 20 to 45 degrees relative to the image plane.",
    )
