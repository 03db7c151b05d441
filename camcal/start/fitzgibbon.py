"""Joint estimation of homographies and a division model: an eigenvalue problem per view, one distortion for all.

A. Fitzgibbon, Simultaneous linear estimation of multiple view geometry and lens distortion, CVPR (2001), sections 2
and 3. With image points p = (u, v, 1 + λ ρ²) about the image's centre, ρ the distance from there, the homography
(or projection matrix) H of the points X of a view satisfies

    p x H X = 0,    (D1 + λ D2) h = 0                                                                    (1)

which multiplication by D1ᵀ makes square: D1ᵀ D1 h = -λ D1ᵀ D2 h. Inliers are found first, in each view, from samples of
five points (six in space; `five_points`). Every real λ of every view is a candidate; the one with the lowest median
error over all views is refined. The undistorted points are then passed to the closed form of a pinhole camera.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.linalg import eig

from camcal.data.observations import Observations, View
from camcal.errors import EstimationError
from camcal.geometry import projective
from camcal.geometry.roots import are_real
from camcal.model.camera import Camera
from camcal.model.lenses import make
from camcal.start import assumptions, dlt, shape, zhang
from camcal.start.base import ClosedForm
from camcal.start.claus import FLATTEST
from camcal.start.five_points import STRONGEST, Equations, agreeing

Array = np.ndarray

#: views from which candidates are taken
CANDIDATE_VIEWS = 12
#: rounds of solving alternately for λ and the h of all views; the change of λ that ends them
ROUNDS, SETTLED = 60, 1e-13


def estimate(correspondences: Observations, skew: bool = False, normalise: bool = True) -> ClosedForm:
    """K, poses and the first coefficient of the division model about the image centre.

    Raises
    ------
    DataError
        If a view has too few points.
    EstimationError
        If no real λ fits, or the closed form fails on the undistorted points.
    """
    form = shape.check(correspondences)
    unit, where = assumptions.unit_coordinates(correspondences)
    scale, centre = 1 / unit[0, 0], -unit[:2, 2] / unit[0, 0]
    views = [_prepared(v, form, i, centre, scale) for i, v in enumerate(correspondences.views)]
    agree = [agreeing(v) for v in views]
    views = [v.take(a) for v, a in zip(views, agree, strict=True)]
    value = _refined(views, _candidate(views))
    flat = _undistorted(correspondences, agree, centre, scale, value)
    found = (zhang if form.planar.all() else dlt).estimate(flat, skew, normalise)
    camera = _division(found.matrix, centre, value / scale**2, correspondences.image_size)
    info: dict[str, Any] = {
        **found.info,
        "assumptions": [*found.info["assumptions"], f"the distortion centre at {where}"],
        "division": float(camera.params[4]),
        "points_left_out": int(sum((~a).sum() for a in agree)),
    }
    return replace(found, name="fitzgibbon", info=info, camera=camera)


def _prepared(view: View, form: shape.Shapes, index: int, centre: Array, scale: float) -> Equations:
    local = (view.xyz - form.origins[index]) @ form.axes[index]
    points = local[:, :2] if form.planar[index] else local
    x = projective.homogeneous(points / np.sqrt((points**2).sum(1).mean()))
    u, v = ((view.uv - centre) / scale).T
    r2 = u * u + v * v
    one, zero = np.ones(len(u)), np.zeros(len(u))
    weight = np.ones(len(u)) if view.sigma is None else 1 / view.sigma

    def rows(p: Array, q: Array, w: Array) -> Array:
        """The three rows of (p, q, w) x H X, as (3N, 3m)."""
        cross = np.array([[zero, -w, q], [w, zero, -p], [-q, p, zero]])  # (3, 3, N)
        return np.einsum("ijn,nk->nijk", cross * weight, x).reshape(len(u), 3, -1)

    return Equations(x, np.stack([u, v], 1), rows(u, v, one), rows(zero, zero, r2))


def _candidate(views: Sequence[Equations]) -> float:
    """Among the λ of the views, the one with the lowest median error over all views."""
    some = views[:: max(1, -(-len(views) // CANDIDATE_VIEWS))]
    found = [0.0]
    for view in some:
        d1, d2 = view.flat
        values = eig(d1.T @ d1, -(d1.T @ d2), right=False)
        real = are_real(values)
        found += [float(v) for v in values[real].real if abs(v) <= STRONGEST]
    errors = [np.median([_error(v, value)[0] for v in some]) for value in found]
    return found[int(np.argmin(errors))]


def _error(view: Equations, value: float) -> tuple[float, Array]:
    """The smallest |(D1 + λ D2) h|² over |h| = 1, divided by its value for h alone, and h."""
    d1, d2 = view.flat
    a = d1 + value * d2
    values, vectors = np.linalg.eigh(a.T @ a)
    h = vectors[:, 0]
    size = float(np.square(h.reshape(3, -1)[2]).sum())  # of the depths: points have unit spread
    return float(max(values[0], 0.0)) / max(size, 1e-300) / len(a), h


def _refined(views: Sequence[Equations], value: float) -> float:
    """The λ with the smallest sum over all views, alternating between λ and the h of the views."""
    for _ in range(ROUNDS):
        upper = lower = 0.0
        for view in views:
            h = _error(view, value)[1]
            size = np.square(h.reshape(3, -1)[2]).sum()
            a, b = (d @ h for d in view.flat)
            upper -= (a @ b) / size
            lower += (b @ b) / size
        if not lower > 0:
            return value
        before, value = value, float(np.clip(upper / lower, -STRONGEST, STRONGEST))
        if abs(value - before) < SETTLED:
            break
    return value


def _undistorted(
    data: Observations, agree: Sequence[Array], centre: Array, scale: float, value: float
) -> Observations:
    """The inliers as a pinhole camera would see them, weighted by the magnification of their noise."""
    views = []
    for whole, chosen in zip(data.views, agree, strict=True):
        view = whole.take(chosen)
        q = (view.uv - centre) / scale
        w = 1 + value * (q**2).sum(1)
        keep = w > FLATTEST
        sigma = (np.ones(len(w)) if view.sigma is None else view.sigma)[keep] / w[keep]
        flat = View(view.id, view.xyz[keep], centre + scale * q[keep] / w[keep, None], sigma)
        if len(flat) < shape.LEAST_PLANAR:
            raise EstimationError(
                f"view '{view.id}': {len(flat)} of {len(view)} points lie within 84 degrees of the axis; "
                f"{shape.LEAST_PLANAR} are needed.",
                "Remove the view.",
            )
        views.append(flat)
    return Observations.from_views(views, data.image_size)


def _division(matrix: Array, centre: Array, value: float, size: tuple[int, int] | None) -> Camera:
    """The division model about the distortion centre; `value` is λ in px⁻²."""
    lens = make("division:1")
    f = float(np.sqrt(matrix[0, 0] * matrix[1, 1]))
    params = lens.pinhole(float(matrix[0, 0]), float(matrix[1, 1]), *map(float, centre))
    params[4] = value * f * f
    return Camera(lens, params, size)
