"""The pose of a known camera from points and their images: all solutions that the data allow, with covariances."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from camcal.data.observations import View
from camcal.errors import DataError, EstimationError
from camcal.geometry import projective, rotations
from camcal.least_squares.distributions import f_bound
from camcal.model.camera import Camera
from camcal.model.pose import Array, Pose
from camcal.records import dataclass
from camcal.routes.distance import half_width
from camcal.routes.outliers import consensus
from camcal.routes.pose_fit import refine_pose
from camcal.solve import p3p
from camcal.start import absolute_pose, shape

LEAST = 3  #: points: Grunert's problem, which has up to four solutions
#: A further minimum is reported if its sum of squares is consistent with the same noise: unless an F test with the
#: degrees of freedom of both rejects it at this level.
LEVEL = 0.999
#: rad, and relative distance; refined minima closer than this are one
SAME = 1e-5
#: A pose is undetermined if a direction of its parameters, each in its own unit, moves the projections by less
#: than this fraction of the direction that moves them most. Eigenvalues, which are the squares, are known to some 1e-15
#: of the largest: with a tenth of this, rounding would decide.
UNDETERMINED = 1e-7
#: points used to select the candidates; all are used in the refinement
SAMPLE = 2000


@dataclass(frozen=True)
class Solution:
    """A local minimum of the reprojection error.

    Attributes
    ----------
    pose : Pose
        cam_from_world.
    residuals : (N, 2) array, px
        Predicted minus observed, of all points; NaN outside the lens's domain.
    rms_point : float
        Over the points used.
    cost : float
        Σ w |r|² over them.
    covariance : (6, 6) array or None
        Of the rotation (rad, on the left) and the translation; None without redundancy and sigmas.
    """

    pose: Pose
    residuals: Array
    rms_point: float
    cost: float
    covariance: Array | None


@dataclass(frozen=True)
class Found:
    """The solutions of a view, the best first, and the points (N,) used."""

    solutions: tuple[Solution, ...]
    used: Array

    @property
    def ratio(self) -> float | None:
        """rms_point of the second solution divided by that of the first; None if there is only one."""
        if len(self.solutions) < 2:
            return None
        first, second = (s.rms_point for s in self.solutions[:2])
        return second / first if first > 0 else float("inf")

    def distance_half_width(self, view: View) -> float | None:
        """Half of the 95 % interval of the distance of the used points' centroid, relative to it, for the first pose;
        None without a covariance.
        """
        best, centre = self.solutions[0], view.xyz[self.used].mean(0)
        if best.covariance is None:
            return None
        own = _about_origin(best.covariance, -(best.pose.rotation @ centre))[3:, 3:]
        freedom = float(2 * self.used.sum() - 6)
        return float(half_width(best.pose.apply(centre), own, freedom or np.inf))


def find(camera: Camera, view: View, robust: str = "auto", seed: int = 0) -> Found:
    """Find all poses that a view allows.

    Parameters
    ----------
    camera : Camera
    view : View
        Three points or more. With exactly three, every solution of Grunert's equations is returned.
    robust : {"auto", "none"}
        `auto` searches for the largest set of points that agree on a pose and excludes the others.
    seed : int
        For the samples that `auto` draws.

    Raises
    ------
    DataError
        If fewer than three points lie inside the lens's domain.
    EstimationError
        If the points are collinear or coincide, so that the pose is undetermined.
    """
    rays = camera.unproject(view.uv)
    inside = np.isfinite(rays).all(1)
    if inside.sum() < LEAST:
        outside = f", {(~inside).sum()} of them outside the lens's domain" if not inside.all() else ""
        raise DataError(
            f"view '{view.id}': {len(view)} points{outside}; a pose needs {LEAST}.", "Add points."
        )
    _require_spread(view, inside)
    used = inside.copy()
    if robust == "auto":
        chosen = consensus(camera, view.take(inside), rays[inside], seed)
        used[np.flatnonzero(inside)[~chosen]] = False
    _require_spread(view, used)
    return Found(tuple(_solutions(camera, view, rays, used)), used)


def fits_mirrored(camera: Camera, view: View, found: Found) -> tuple[float, float] | None:
    """rms_point, px, of the points as given and with v counted upwards, if only the latter fit.

    All points are used, and an F test must reject that both have the same noise. A mirrored plane is a plane seen from
    behind, so that both fit.
    """
    turned = np.c_[view.uv[:, 0], 2 * camera.matrix[1, 2] - view.uv[:, 1]]
    try:
        own = (found if found.used.all() else find(camera, view, "none")).solutions[0]
        other = find(camera, replace(view, uv=turned), "none").solutions[0]
    except (DataError, EstimationError):
        return None
    if _could_be(own, other, len(view)):
        return None
    return own.rms_point, other.rms_point


def _require_spread(view: View, used: Array) -> None:
    spread = projective.principal_spreads(view.xyz[used])
    if spread[1] <= shape.COLLINEAR * spread[0]:
        what = (
            "lie on a line: any rotation about it" if spread[0] > 0 else "coincide: any rotation about them"
        )
        raise EstimationError(
            f"view '{view.id}': its {used.sum()} points {what} fits as well, so the pose is undetermined.",
            "Add a point off the line.",
        )


def _solutions(camera: Camera, view: View, rays: Array, used: Array) -> list[Solution]:
    kept, d = view.take(used), rays[used]
    few = np.arange(len(kept))
    if len(kept) > SAMPLE:
        few = few[:: -(-len(kept) // SAMPLE)]
    weights = None if kept.sigma is None else kept.sigma[few] ** -2.0
    if len(kept) == LEAST:
        exact = p3p.poses(kept.xyz[None], d[None])[0]
        starts = [Pose(m[:, :3], m[:, 3]) for m in exact if np.isfinite(m).all()]
    else:
        starts = list(absolute_pose.candidates(kept.xyz[few], d[few], weights))
    found: list[Solution] = []
    for start in starts:
        one = _refined(camera, view, used, start)
        if one is not None and not any(_same(one.pose, other.pose) for other in found):
            found.append(one)
    if not found:
        raise EstimationError(
            f"view '{view.id}': no pose puts its {len(kept)} points in front of the camera.",
            "Check that each image point belongs to its object point (with eight points or more, up to "
            "half may be wrong), and the order of the columns.",
        )
    found.sort(key=lambda s: s.cost)
    return [s for s in found if _could_be(s, found[0], len(kept))]


def _could_be(solution: Solution, best: Solution, count: int) -> bool:
    """Return whether a minimum's residuals are consistent with noise of the size of the best one's."""
    freedom = 2 * count - 6
    if freedom == 0:
        return True
    # exact data: the residuals are rounding of the coordinates, to which no test applies
    rounding = count * (1e-9) ** 2
    return solution.cost <= f_bound(1 - LEVEL, freedom, freedom) * max(best.cost, rounding)


def _same(a: Pose, b: Pose) -> bool:
    apart = float(rotations.angle_between(a.rotation, b.rotation))
    return apart < SAME and bool(
        np.linalg.norm(a.translation - b.translation) < SAME * np.linalg.norm(b.translation)
    )


def _refined(camera: Camera, view: View, used: Array, start: Pose) -> Solution | None:
    """The local minimum of the reprojection error near a pose; None outside the lens's domain."""
    kept = view.take(used)
    centre = kept.xyz.mean(0)
    local = kept.xyz - centre
    roots = kept.root_weights

    # about the points' centroid, where rotation and translation are nearly uncorrelated
    centred = Pose(start.rotation, start.translation + start.rotation @ centre)
    fit = refine_pose(camera, local, kept.uv, roots, centred)
    if fit is None:
        return None
    _require_determined(view, fit.normal.shared)
    pose = Pose(fit.state.rotation, fit.state.translation - fit.state.rotation @ centre)
    residuals = camera.project(pose.apply(view.xyz)) - view.uv
    cost = 2 * fit.normal.cost
    covariance = _covariance(fit.normal.shared, cost, 2 * len(kept) - 6, kept.sigma is not None)
    if covariance is not None:
        covariance = _about_origin(covariance, pose.rotation @ centre)
    rms = float(np.sqrt(np.square(residuals[used]).sum(1).mean()))
    return Solution(pose, residuals, rms, cost, covariance)


def _require_determined(view: View, normal: Array) -> None:
    scale = np.sqrt(np.diagonal(normal))
    known = bool((scale > 0).all())
    if known:
        values = np.linalg.eigvalsh(normal / np.outer(scale, scale))
        known = bool(values[0] > UNDETERMINED**2 * values[-1])
    if not known:
        raise EstimationError(
            f"view '{view.id}': its points leave the pose undetermined.", "Add points at other positions."
        )


def _covariance(normal: Array, cost: float, freedom: int, weighted: bool) -> Array | None:
    """(JᵀJ)⁻¹ scaled by the variance of the residuals; by 1 with sigmas and no redundancy."""
    if freedom == 0 and not weighted:
        return None
    scale = np.sqrt(np.diagonal(normal))
    inverse = np.linalg.inv(normal / np.outer(scale, scale)) / np.outer(scale, scale)
    return inverse * (cost / freedom if freedom else 1.0)


def _about_origin(covariance: Array, offset: Array) -> Array:
    """The covariance with the translation of the world's origin instead of the centroid's.

    t = c - R x̄, so that dt = dc + [R x̄] δ for exp(δ) R.
    """
    change = np.eye(6)
    change[3:, :3] = rotations.skew(offset)
    return change @ covariance @ change.T
