"""Rays as a rational function of the pixel, linear in its coefficients, without a lens model or initial values.

D. Claus, A. Fitzgibbon, A rational function lens distortion model for general cameras, CVPR (2005), sections 2
and 3. With the lifted pixel χ = (u², uv, v², u, v, 1), the ray of a pixel is

    d ~ A χ,  A (3, 6)                                                                                  (1)

which includes rays beyond 90 degrees. Points X = (x, y, 1) of a plane seen by a view satisfy X ~ B χ, B = H⁻¹ A, so
that

    X x B χ = 0                                                                                         (2)

is linear in the 18 entries of B: nine points of one view determine them. The row spaces of all B equal that of A, which
is the dominant one of all B stacked. This determines A up to a homography. About the image's centre, where a symmetric
lens has its axis, (1) is required to be a pinhole camera to first order, which leaves only the camera matrix unknown.
The pixels that such a pinhole camera would see go to Zhang's closed form, from one or two views under its assumptions.

Without distortion, A times any (a u + b v + c) gives the same rays, and B is not unique. A weak prior keeps the
quadratic terms small (`PRIOR`); any visible distortion overrules it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from camcal.data.observations import Observations, View
from camcal.errors import DataError, EstimationError
from camcal.model.camera import Camera
from camcal.records import dataclass
from camcal.start import assumptions, shape, zhang
from camcal.start.base import ClosedForm
from camcal.start.of_rays import camera_of

Array = np.ndarray

#: 18 entries up to scale, two equations per point
LEAST_POINTS = 9
#: depth of a ray beside that at the centre: rays nearer to a right angle to the axis cannot be used for a pinhole
#: camera (84 degrees at f = ρ)
FLATTEST = 0.1
#: rounds of reweighting: equations (2) are in units of the plane, noise is in px
WEIGHTINGS = 4
#: ratio of the penalty of quadratic coefficients of 1 to the cost of the noise of all points. On boards with 0.3 px of
#: noise and no distortion 10 leaves five of ten runs of eight views without a camera and 100 none; 1000 takes 3 %
#: off the focal length of two views through a division of -0.4, 100 takes 0.6 %
PRIOR = 100.0
#: of the median scale of the map from image to plane: at smaller scales the map folds, and the points are omitted
FOLD = 1e-3
#: condition of Q above which the rays have fewer than ten of 16 digits
MOST_CONDITION = 1e6
#: relative lower limit of the noise of the equations: below it the prior would be lost in rounding
LEAST_NOISE = 1e-7


def estimate(correspondences: Observations, skew: bool = False, normalise: bool = True) -> ClosedForm:
    """K, poses and a division model regressed to the rays, from one or more views of a plane.

    Raises
    ------
    DataError
        If a view has fewer than nine points.
    EstimationError
        For points in space, and if Zhang's closed form fails on the undistorted points.
    """
    form = shape.check(correspondences)
    if not form.planar.all():
        raise EstimationError(
            "the closed form 'claus' accepts views of planes, not of points in space.",
            "Use 'fitzgibbon' or 'tsai'.",
        )
    unit, where = assumptions.unit_coordinates(correspondences)
    scale, centre = 1 / unit[0, 0], -unit[:2, 2] / unit[0, 0]
    views = [_prepared(v, form, i, centre, scale) for i, v in enumerate(correspondences.views)]
    a = pinhole_at_centre(_common_rows(views))
    flat = _undistorted(correspondences, a, centre, scale)
    found = zhang.estimate(flat, skew, normalise)
    camera = _camera(found.matrix, a, correspondences, centre, scale)
    info: dict[str, Any] = {
        **found.info,
        "assumptions": [*found.info["assumptions"], f"the distortion centre at {where}"],
        "rational": a.tolist(),
    }
    return replace(found, name="claus", info=info, camera=camera)


def lifted(q: Array) -> Array:
    """χ (N, 6) of points (N, 2)."""
    u, v = q.T
    return np.stack([u * u, u * v, v * v, u, v, np.ones(len(u))], 1)


@dataclass(frozen=True)
class _View:
    """Points (N, 2) of a plane, of unit spread; pixels (N, 2) in half diagonals about the centre; weights (N,)."""

    points: Array
    pixels: Array
    roots: Array


def _prepared(view: View, form: shape.Shapes, index: int, centre: Array, scale: float) -> _View:
    if len(view) < LEAST_POINTS:
        raise DataError(
            f"view '{view.id}' holds {len(view)} points; the closed form 'claus' needs {LEAST_POINTS}.",
            "Remove the view, or give it more points.",
        )
    local = ((view.xyz - form.origins[index]) @ form.axes[index])[:, :2]
    roots = view.root_weights
    spread = np.sqrt((local**2).sum(1).mean())
    return _View(local / spread, (view.uv - centre) / scale, roots / np.sqrt((roots**2).mean()))


def _common_rows(views: Sequence[_View]) -> Array:
    """The three orthonormal rows (3, 6) that the maps of all views share."""
    bases = [np.linalg.qr(_map(v).T)[0].T * np.sqrt(len(v.points)) for v in views]
    return np.linalg.svd(np.concatenate(bases))[2][:3]


def _map(view: _View) -> Array:
    """B (3, 6) of (2), by least squares in px to first order."""
    chi, roots = lifted(view.pixels), view.roots
    by_u, by_v = derivatives(view.pixels)
    quadratic = np.tile([1.0, 1, 1, 0, 0, 0], 3)
    for _ in range(WEIGHTINGS):
        zero = np.zeros_like(chi)
        x, y = view.points.T[:, :, None]
        rows = np.concatenate([np.c_[chi, zero, -x * chi], np.c_[zero, chi, -y * chi]])
        rows = rows * np.tile(roots, 2)[:, None]
        b = _least(rows, quadratic).reshape(3, 6)
        onto = chi @ b.T
        at = onto[:, :2] / onto[:, 2:]
        du, dv = ((d @ b[:2].T - at * (d @ b[2])[:, None]) / onto[:, 2:] for d in (by_u, by_v))
        area = np.abs(du[:, 0] * dv[:, 1] - du[:, 1] * dv[:, 0])
        size = np.abs(onto[:, 2]) * np.sqrt(area)
        usable = np.isfinite(size) & (size > FOLD * np.median(size))
        roots = np.where(usable, view.roots / np.where(usable, size, 1.0), 0.0)
    return b


def _least(rows: Array, quadratic: Array) -> Array:
    """The unit vector with the smallest sum of squares; the prior holds the quadratic terms."""
    normal = rows.T @ rows
    floor = max(np.linalg.eigvalsh(normal)[0], LEAST_NOISE**2 * float(np.trace(normal)))
    return np.asarray(np.linalg.eigh(normal + PRIOR * floor * np.diag(quadratic))[1][:, 0])


def derivatives(q: Array) -> tuple[Array, Array]:
    """∂χ/∂u and ∂χ/∂v (N, 6)."""
    u, v = q.T
    zero, one = np.zeros(len(u)), np.ones(len(u))
    return np.stack([2 * u, v, zero, one, zero, zero], 1), np.stack([zero, u, 2 * v, zero, one, zero], 1)


def pinhole_at_centre(rows: Array) -> Array:
    """A (3, 6) of the homography that makes pixels near the centre those of a pinhole camera: [Q, I]."""
    if not np.linalg.cond(rows[:, 3:]) < MOST_CONDITION:
        raise EstimationError(
            "the lifted homographies leave the rays near the image centre undetermined.",
            "Add views that cover more of the picture.",
        )
    return np.asarray(np.linalg.solve(rows[:, 3:], rows))


def _undistorted(data: Observations, a: Array, centre: Array, scale: float) -> Observations:
    """The points as seen by a pinhole camera, weighted by the magnification of their noise."""
    views = []
    for view in data.views:
        ray = lifted((view.uv - centre) / scale) @ a.T
        keep = ray[:, 2] > FLATTEST
        if keep.sum() < shape.LEAST_PLANAR:
            raise EstimationError(
                f"view '{view.id}': {int(keep.sum())} of {len(view)} points lie within 84 degrees of the axis; "
                f"{shape.LEAST_PLANAR} are needed.",
                "Remove the view.",
            )
        depth = ray[keep, 2]
        sigma = (np.ones(len(view)) if view.sigma is None else view.sigma)[keep] / depth
        views.append(View(view.id, view.xyz[keep], centre + scale * ray[keep, :2] / depth[:, None], sigma))
    return Observations.from_views(views, data.image_size)


def _camera(matrix: Array, a: Array, data: Observations, centre: Array, scale: float) -> Camera:
    """The lens of the table nearest to the rays at the pixels of the data."""
    to_px = np.array([[scale, 0, centre[0]], [0, scale, centre[1]], [0, 0, 1]])
    uv = np.concatenate([v.uv for v in data.views])
    rays = lifted((uv - centre) / scale) @ (np.linalg.solve(matrix, to_px) @ a).T
    return camera_of(rays, uv, data.image_size)
