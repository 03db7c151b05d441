"""Projection uncertainty: the effect of noise on the projection of a point.

Single parameters can be uncertain although the camera is accurate, because their errors cancel, and a camera moves
together with the frame implied by its poses. Therefore a point is fixed in the frame of the boards, and its
projection is considered, as in mrcal ("projection uncertainty", method mean-pcam). With the point p in the camera's
frame at the solution, X_v = R_vᵀ (p - t_v) is where it stands on the board of view v. Other observations would have
given other parameters and poses; the point is then where the boards say on average:

    p' = 1/V Σ_v (R'_v X_v + t'_v),     q' = project(params', p')                                         (1)

To first order p' - p = ω x p + τ is a twist (ω, τ), the mean over the boards of

    (ω, τ)_v = E_v (δrotation, δcentroid)_v,   E_v = [I 0; [c_v]ₓ I]                                      (2)

with c_v the centroid about which a view's rotation is taken (`NormalBlocks`). The poses follow the camera's
free parameters by -B_v δf and scatter besides by their own noise, both known from the Schur blocks
(`covariance.py`). With B = 1/V Σ E_v B_v, N = sigma_0² / V² Σ E_v A_v⁻¹ E_vᵀ, J_f = dq/dparams T and
J_p = dq/dp [-[p]ₓ  I]:

    cov(q) = (J_f - J_p B) C_f (J_f - J_p B)ᵀ + J_p N J_pᵀ                                                (3)

which costs two small products a pixel, however many views there are. At infinity p is a direction, and τ
drops out. Where the board's shape is estimated, the board's frame is that in which its points are nearest to
the ideal ones: the similarity that does this moves with the shape's parameters, and B takes that in.

Along a direction that is curved (`curvature.py`) the same is done without linearising: (1) with the camera and the
poses at either end of the interval gives q' - q, of which a half is a standard deviation, and the larger of both ends
is added,

    cov(q) + ¼ (q' - q)(q' - q)ᵀ                                                                        (4)

The linear part of that direction is then in it twice where it holds, which is on the safe side. Where the interval has
no end, what has moved by more than (3) says, up to where it was looked at, is undetermined.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from camcal.assess.covariance import Covariance, End, covariance
from camcal.assess.difference import image_grid
from camcal.geometry import rotations
from camcal.geometry.numbers import median
from camcal.model.camera import Camera
from camcal.model.pose import Poses
from camcal.records import dataclass
from camcal.solve.calibration import Calibration

Array = np.ndarray

#: Pixels that a unit step along an undetermined direction (unit length in scaled columns, so that all
#: observations together move by about 1 px) may move a projection before the projection counts as
#: undetermined. Such a direction's sigma is 1e6 and more: what moves by 1e-6 px has at least 1 px.
_MOVED = 1e-6
#: Columns of the map over the image.
COLUMNS = 20


@dataclass(frozen=True)
class ProjectionUncertainty:
    """The inputs of equation (3).

    Attributes
    ----------
    camera : Camera
    transform : (P, F) array
        T = d params / d free parameters.
    free : (F, F) array
        C_f.
    null : (F, K) array
        Undetermined directions of the free parameters.
    follow : (6, F) array
        B: how the reference frame follows the free parameters, with a minus sign.
    own : (6, 6) array
        N: scatter of the reference frame of its own; infinite where no pose is determined.
    poses : Poses, optional
        Of the views over whose boards (1) takes its mean, for (4).
    ends : tuple of End
        With the poses of the same views.
    """

    camera: Camera
    transform: Array
    free: Array
    null: Array
    follow: Array
    own: Array
    poses: Poses | None = None
    ends: tuple[End, ...] = ()

    def at_pixels(self, pixels: Array, distance: float = np.inf) -> Array:
        """Covariances (N, 2, 2), px², at pixels (N, 2), for points at a distance from the camera.

        NaN outside the lens's domain, inf on the diagonal where the data leave the projection undetermined.
        """
        return self.of_points(self.camera.unproject(pixels) * (1.0 if np.isinf(distance) else distance),
                              at_infinity=bool(np.isinf(distance)))  # fmt: skip

    def of_points(
        self, xyz: Array, at_infinity: bool = False, jacobians: tuple[Array, Array] | None = None
    ) -> Array:
        """Covariances (N, 2, 2), px², of the projections of points (N, 3) of the camera's frame.

        `jacobians` are those of the camera at these points, where they are known already.
        """
        by_params, by_frame = self.jacobians(xyz, at_infinity) if jacobians is None else jacobians
        moved = by_params - by_frame @ self.follow
        # infinite entries of N would make NaN of the zeros that they meet
        lost = ~np.isfinite(self.own).all() or not np.isfinite(self.free).all()
        with np.errstate(invalid="ignore"):
            found = moved @ self.free @ moved.transpose(0, 2, 1)
            found = found + by_frame @ self.own @ by_frame.transpose(0, 2, 1)
            found = found + self._of_ends(xyz, at_infinity, np.trace(found, axis1=1, axis2=2))
            undetermined = np.abs(moved @ self.null).max((1, 2), initial=0.0) > _MOVED
        undetermined |= lost & np.isfinite(by_params).all((1, 2))
        found[undetermined] = np.diag([np.inf, np.inf])
        return np.asarray(found)

    def _of_ends(self, xyz: Array, at_infinity: bool, linear: Array) -> Array:
        """The contribution of (4) at points (N, 3), (N, 2, 2) px²; infinite where the camera at an end does not
        see one.
        """
        total = np.zeros((len(xyz), 2, 2))
        if self.poses is None or not self.ends:
            return total
        here = self.camera.project(xyz)
        r, t = self.poses.rotations, self.poses.translations
        on_boards = (xyz if at_infinity else xyz - t[:, None]) @ r  # Rᵀ x, (V, N, 3)
        for direction in sorted({end.direction for end in self.ends}):
            most = np.zeros_like(here)
            for end in (e for e in self.ends if e.direction == direction):
                seen = on_boards @ end.poses.rotations.transpose(0, 2, 1)
                seen = seen.mean(0) if at_infinity else (seen + end.poses.translations[:, None]).mean(0)
                moved = end.part * (self.camera.lens.project(end.params, seen)[0] - here)
                lost = ~np.isfinite(moved).all(1)
                if end.endless:  # beyond this end it moves further, without limit
                    lost |= ~(np.square(moved).sum(1) <= linear)
                moved = np.where(lost[:, None], np.inf, moved)
                larger = np.square(moved).sum(1) > np.square(most).sum(1)
                most = np.where(larger[:, None], moved, most)
            total += most[:, :, None] * most[:, None, :] / 4
        return total

    def jacobians(self, xyz: Array, at_infinity: bool = False) -> tuple[Array, Array]:
        """J_f (N, 2, F) and J_p (N, 2, 6) of (3), at points (N, 3) of the camera's frame."""
        _, by_xyz, by_params, _ = self.camera.lens.jacobians(self.camera.params, xyz)
        turn = -by_xyz @ rotations.skew(xyz)
        shift = np.zeros_like(by_xyz) if at_infinity else by_xyz
        return by_params @ self.transform, np.concatenate([turn, shift], 2)


def projection_uncertainty(
    solution: Calibration, accuracy: Covariance | None = None, views: Array | None = None
) -> ProjectionUncertainty:
    """Prepare equation (3) for a solution.

    Parameters
    ----------
    solution : Calibration
    accuracy : Covariance, optional
        That of the solution, where it is known already.
    views : (K,) int array, optional
        The views over whose boards (1) takes its mean; all by default.
    """
    accuracy = accuracy or covariance(solution)
    reduced = accuracy.poses_reduced
    scale = accuracy.sigma_0 if np.isfinite(accuracy.sigma_0) else np.inf
    good = np.flatnonzero(~reduced.undetermined.any(1))
    if views is not None:
        good = good[np.isin(good, views, kind="sort")]
    size = solution.free.shape[1]
    if not len(good):
        follow, own = np.zeros((6, size)), np.full((6, 6), np.inf)
    else:
        e = twists(_centroids(solution)[good])
        follow = (e @ reduced.gain[good]).mean(0) - board_follow(solution, good)
        own = (e @ reduced.inverse[good] @ e.transpose(0, 2, 1)).sum(0) / len(good) ** 2
        own = scale**2 * own if np.isfinite(scale) else np.full((6, 6), np.inf)
    free = accuracy.free if np.isfinite(scale) else np.full_like(accuracy.free, np.inf)
    ends = tuple(replace(end, poses=end.poses[good]) for end in accuracy.ends)
    return ProjectionUncertainty(
        solution.camera, solution.free, free, accuracy.null, follow, own, solution.poses[good], ends
    )


def _centroids(solution: Calibration) -> Array:
    """The centroids (V, 3) of the used points in the camera's frame, about which the poses rotate."""
    kept, poses = solution.observations.kept(), solution.poses
    sums = np.stack([np.bincount(kept.view, x, len(poses)) for x in kept.xyz.T], 1)
    offsets = sums / np.bincount(kept.view, minlength=len(poses))[:, None]
    return np.einsum("vij,vj->vi", poses.rotations, offsets) + poses.translations


def twists(centroids: Array) -> Array:
    """E_v of (2), (V, 6, 6)."""
    out = np.tile(np.eye(6), (len(centroids), 1, 1))
    out[:, 3:, :3] = rotations.skew(centroids)
    return out


def board_follow(solution: Calibration, views: Array) -> Array:
    """The mean twist (6, F) of the board's frame under its shape parameters.

    The frame is settled on the points: offsets δX of theirs that look like a + b x X + s X are taken for a
    motion of the frame. In the camera's frame a point that is fixed to the board then moves by
    ω = R b, τ = R a - (R b) x t - s t; what is left of s moves it along its ray, where nothing is seen.
    """
    out = np.zeros((6, solution.free.shape[1]))
    board = solution.board
    if board is None or board.basis is None or board.label is not None:
        return out  # the shapes of several boards leave each frame where it is
    x = board.points - board.points.mean(0)
    rows = np.concatenate(
        [np.tile(np.eye(3), (len(x), 1, 1)), -rotations.skew(x), x[:, :, None]], axis=2
    ).reshape(-1, 7)
    a, b, s = np.split(np.linalg.pinv(rows) @ board.directions(), [3, 6])
    a = a - rotations.skew(board.points.mean(0)).T @ b - board.points.mean(0)[:, None] * s
    r, t = solution.poses.rotations[views], solution.poses.translations[views]
    turn = (r @ b).mean(0)
    shift = (r @ a + rotations.skew(t) @ (r @ b) - t[:, :, None] * s).mean(0)
    out[:, out.shape[1] - board.size :] = np.r_[turn, shift]
    return out


def worst_sigma(covariances: Array) -> Array:
    """Standard deviation (N,) in the worst direction, px, of covariances (N, 2, 2); inf and NaN pass."""
    a, b, c = covariances[:, 0, 0], covariances[:, 0, 1], covariances[:, 1, 1]
    with np.errstate(invalid="ignore"):
        largest = (a + c) / 2 + np.hypot((a - c) / 2, b)
        return np.asarray(np.where(np.isinf(a) | np.isinf(c), np.inf, np.sqrt(np.maximum(largest, 0))))


@dataclass(frozen=True)
class UncertaintyMap:
    """The worst-direction sigma over the image at one distance.

    Attributes
    ----------
    distance : float
        From the camera, unit of the data; inf.
    pixels : (R, C, 2) array
    sigmas : (R, C) array
        px; NaN outside the lens's domain.
    """

    distance: float
    pixels: Array
    sigmas: Array

    @property
    def median(self) -> float:
        """The median over the image, px; NaN if the lens sees none of it."""
        found = self.sigmas[~np.isnan(self.sigmas)]
        return median(found)

    @property
    def worst(self) -> tuple[float, float, float]:
        """u, v and sigma at the maximum, px."""
        if np.isnan(self.sigmas).all():
            return (float("nan"),) * 3
        at = np.unravel_index(np.nanargmax(self.sigmas), self.sigmas.shape)
        u, v = self.pixels[at].tolist()
        return u, v, float(self.sigmas[at])


def map_over_image(
    uncertainty: ProjectionUncertainty,
    low: Array,
    high: Array,
    distance: float = np.inf,
    columns: int = COLUMNS,
) -> UncertaintyMap:
    """The map between the pixels `low` and `high`, both (2,) and included."""
    pixels = image_grid(low, high, columns)
    sigmas = worst_sigma(uncertainty.at_pixels(pixels, distance))
    return UncertaintyMap(distance, pixels.reshape(-1, columns, 2), sigmas.reshape(-1, columns))


def board_distance(solution: Calibration) -> float:
    """The median distance of the boards' centroids from the camera, unit of the data; NaN without a view."""
    far = np.linalg.norm(_centroids(solution), axis=1)
    return median(far)
