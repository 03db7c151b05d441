"""Poses of views whose rays are known: linear starts and a few steps of the least-squares loop, all views at once.

Image points are given as normalised coordinates (x/z, y/z) of their rays, so that any lens can be removed first.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from camcal.data.observations import Observations, View
from camcal.errors import DataError
from camcal.geometry import dlt, homography, rotations
from camcal.least_squares import Normal, Options, Small, minimise
from camcal.model.pose import Poses
from camcal.records import dataclass
from camcal.start import shape

Array = np.ndarray

#: Below this ratio of extents a planar start is tried besides the DLT, whose depths are then dominated by noise.
SHALLOW = 0.2


#: The second planar solution is refined further if two steps bring its error below this multiple of the
#: first's.
RIVAL = 9.0


#: Relative accuracy of the minimum error of a view: sufficient as the start of a refinement.
SETTLED = 1e-6
#: Half the square of a residual in normalised coordinates that rounding makes, about 1e-13.
ROUNDING = 0.5e-26


@dataclass(frozen=True)
class Polished:
    """Poses of V views and their weighted sums of squares (V,)."""

    poses: Poses
    cost: Array

    @classmethod
    def none(cls, count: int) -> Polished:
        """Placeholder poses with infinite cost."""
        return cls(
            Poses(np.tile(np.eye(3), (count, 1, 1)), np.full((count, 3), np.nan)), np.full(count, np.inf)
        )

    def or_better(self, other: Polished, rows: Array | slice = slice(None)) -> Polished:
        """Take over the poses of `other`, which holds the views `rows`, wherever their cost is lower."""
        r, t, cost = self.poses.rotations.copy(), self.poses.translations.copy(), self.cost.copy()
        rows = np.arange(len(cost))[rows]
        better = other.cost < cost[rows]
        r[rows[better]], t[rows[better]] = other.poses.rotations[better], other.poses.translations[better]
        cost[rows[better]] = other.cost[better]
        return Polished(Poses(r, t), cost)


def initial_poses(
    views_xyz: Sequence[Array],
    views_ab: Sequence[Array],
    views_sigma: Sequence[Array | None] | None = None,
    steps: int = 20,
) -> Poses:
    """cam_from_board of each view from points and normalised image coordinates.

    Points on a plane start from a homography (Zhang 2000, section 3.1) and from its second solution, the
    plane's normal mirrored at the line of sight (Schweighofer & Pinz, Robust pose estimation from a planar
    target, 2006); points in space from a DLT. Each start takes up to `steps` Levenberg-Marquardt steps, the
    lowest error wins.

    Parameters
    ----------
    views_xyz : sequence of (N, 3) arrays
    views_ab : sequence of (N, 2) arrays
        x/z and y/z in the camera's frame.
    views_sigma : sequence of (N,) arrays, optional
        Standard deviations, of any common unit.
    steps : int

    Returns
    -------
    Poses

    Raises
    ------
    DataError
        If a view has too few points, or all on a line.
    """
    sigma = views_sigma if views_sigma is not None else [None] * len(views_xyz)
    views = tuple(
        View(str(i + 1), x, a, s) for i, (x, a, s) in enumerate(zip(views_xyz, views_ab, sigma, strict=True))
    )
    form = shape.check(Observations.from_views(views))
    rotation, translation = np.zeros((len(views), 3, 3)), np.zeros((len(views), 3))
    for index, xyz, ab, w in shape.batches(views):
        for kind in (True, False):
            rows = form.planar[index] == kind
            which = index[rows]
            if not len(which):
                continue
            r, t = _group(xyz[rows], ab[rows], w[rows], form, which, kind, steps)
            rotation[which], translation[which] = r, t
    if not np.isfinite(translation).all():
        bad = views[int(np.flatnonzero(~np.isfinite(translation).all(1))[0])].id
        raise DataError(
            f"view {bad}: its points leave its pose undetermined.", "Use points in general position."
        )
    return Poses(rotation, translation)


def poses_for(matrix: Array, correspondences: Observations) -> Poses:
    """cam_from_board of each view for a pinhole camera matrix (3, 3); see `initial_poses`."""
    inverse = np.linalg.inv(matrix)
    views = correspondences.views
    return initial_poses(
        [v.xyz for v in views],
        [v.uv @ inverse[:2, :2].T + inverse[:2, 2] for v in views],
        [v.sigma for v in views],
    )


def from_homographies(matrix: Array, h: Array) -> Poses:
    """Poses of planes z = 0 from K (3, 3) and homographies (V, 3, 3) whose sign makes depths positive.

    Zhang 2000, section 3.1; the rotation is the nearest one in the Frobenius norm (his appendix C).
    """
    return from_normalised(np.linalg.inv(matrix) @ h)


def from_normalised(m: Array) -> Poses:
    """`from_homographies` of K⁻¹ H (V, 3, 3)."""
    lengths = np.sqrt(np.einsum("vij,vij->vj", m[..., :2], m[..., :2]))
    m = m * (2 / lengths.sum(1))[:, None, None]
    r = np.empty_like(m)
    r[..., :2] = m[..., :2]
    (a, b, c), (d, e, f) = m[..., 0].T, m[..., 1].T
    r[:, 0, 2], r[:, 1, 2], r[:, 2, 2] = b * f - c * e, c * d - a * f, a * e - b * d
    return Poses(rotations.nearest(r), m[..., 2])


def from_plane(poses: Poses, origins: Array, axes: Array) -> Poses:
    """Poses of the data's frame from poses of planes: x_plane = axesᵀ (x - origin)."""
    rotation = poses.rotations @ np.swapaxes(axes, -1, -2)
    return Poses(rotation, poses.translations - np.einsum("vij,vj->vi", rotation, origins))


def second_solution(poses: Poses) -> Poses:
    """The other pose that explains a small planar target about its origin nearly as well.

    Depth relative to the origin changes its sign along the line of sight d: R' = (I - 2 d dᵀ) R diag(1, 1,
    -1).
    """
    d = poses.translations / np.linalg.norm(poses.translations, axis=-1, keepdims=True)
    mirror = np.eye(3) - 2 * d[:, :, None] * d[:, None, :]
    return Poses(mirror @ poses.rotations * np.array([1.0, 1.0, -1.0]), poses.translations)


def _group(
    xyz: Array, ab: Array, w: Array, form: shape.Shapes, which: Array, planar: bool, steps: int
) -> tuple[Array, Array]:
    """Poses of views with the same number of points, all planar or all in space."""
    origins, axes = form.origins[which], form.axes[which]
    local = (xyz - origins[:, None]) @ axes
    starts = []
    if planar or (form.spreads[which, 2] < SHALLOW * form.spreads[which, 0]).any():
        starts.append(from_homographies(np.eye(3), homography.homographies(local[..., :2], ab, w)))
    if not planar:
        starts.append(_from_dlt(local, ab, w))
    best = Polished.none(len(which))
    for start in starts:
        best = best.or_better(polish(start, local, ab, w, steps))
    if planar:
        best = _against_second(best, local, ab, w, steps)
    found = from_plane(best.poses, origins, axes)
    return found.rotations, found.translations


def _against_second(best: Polished, local: Array, ab: Array, w: Array, steps: int) -> Polished:
    """Use the second planar solution if it is better.

    After a few steps only the views in which it may be better are refined further.
    """
    second = polish(second_solution(best.poses), local, ab, w, 3)
    rivals = np.flatnonzero(second.cost < RIVAL * best.cost)
    if not len(rivals):
        return best
    second = polish(second.poses[rivals], local[rivals], ab[rivals], w[rivals], steps)
    return best.or_better(second, rivals)


def lower_minimum(poses: Poses, local: Array, ab: Array, w: Array, steps: int = 20) -> Poses:
    """The lower of the two minima of each plane's pose, starting near one of them.

    A few steps in both distinguish most of them; only the remaining ones are both refined to convergence.

    Parameters
    ----------
    poses : Poses
        Camera from plane, of V views.
    local : (V, N, 3) array
        Points of the planes about their centroids, z = 0.
    ab : (V, N, 2) array
        x/z and y/z in the camera's frame.
    w : (V, N) array
    steps : int
    """
    both = Polished(_joined(poses, second_solution(poses)), np.full(2 * len(poses), np.inf))
    unsettled = np.arange(len(poses))
    for most in (3, steps):  # the two starts of each view side by side: as many calls as for one
        rows = np.r_[unsettled, len(poses) + unsettled]
        xyz, seen, weights = (np.concatenate([a[unsettled], a[unsettled]]) for a in (local, ab, w))
        both = both.or_better(polish(both.poses[rows], xyz, seen, weights, most), rows)
        first, second = both.cost.reshape(2, -1)
        unsettled = np.flatnonzero(np.maximum(first, second) < RIVAL * np.minimum(first, second))
        if not len(unsettled):
            break
    better = second < first
    return both.poses[np.arange(len(poses)) + len(poses) * better]


def _joined(a: Poses, b: Poses) -> Poses:
    return Poses(np.r_[a.rotations, b.rotations], np.r_[a.translations, b.translations])


def _from_dlt(xyz: Array, ab: Array, w: Array) -> Poses:
    """Poses from the projection matrices of views in normalised coordinates, K = I."""
    p = dlt.projection_matrices(xyz, ab, w)
    scale = np.linalg.norm(p[..., :3], axis=(1, 2)) / np.sqrt(3)
    p = p / scale[:, None, None]
    return Poses(rotations.nearest(p[..., :3]), p[..., 3])


def polish(poses: Poses, xyz: Array, ab: Array, w: Array, steps: int) -> Polished:
    """Lower the reprojection error of each view.

    Parameters
    ----------
    poses : Poses of V views
    xyz : (V, N, 3) array
    ab : (V, N, 2) array, normalised coordinates
    w : (V, N) array, weights
    steps : int

    Returns
    -------
    Polished
        Its cost is inf if a point is behind the camera.
    """
    problem = _Views(xyz, ab, w)
    found = minimise(problem, _Placed(poses.rotations, poses.translations), Options(SETTLED, steps))
    return Polished(Poses(*found.state), 2 * found.equations.cost)


class _Placed(NamedTuple):
    """Rotations (V, 3, 3) and translations (V, 3)."""

    rotations: Array
    translations: Array


class _Views(Small):
    """Views with the same number of points, each with its pose; residuals in normalised coordinates."""

    def __init__(self, xyz: Array, ab: Array, w: Array):
        self.count = len(xyz)
        self.rounding = ROUNDING * w.sum(1)
        by_axis = (np.ascontiguousarray(np.swapaxes(a, 1, 2)) for a in (xyz, ab))
        self.data = *by_axis, None if (w == 1.0).all() else np.sqrt(w)
        self.left, self.some = np.arange(self.count), self.data

    def linearise(self, state: _Placed, members: Array) -> Normal:
        """The equations; behind the camera the cost is inf and the equations follow the same formulas."""
        if len(members) != len(self.left):
            self.left = members
            self.some = tuple(None if a is None else a[members] for a in self.data)
        points, observed, root = self.some
        turned = state.rotations @ points
        depth = turned[:, 2] + state.translations[:, 2, None]
        inverse = 1 / np.where(depth == 0, 1.0, depth)
        predicted = turned[:, :2] + state.translations[:, :2, None]
        predicted *= inverse[:, None]
        turned *= inverse[:, None]
        normal = Normal.of(*_rows(turned, predicted, predicted - observed, inverse, root))
        return normal._replace(cost=np.where((depth > 0).all(1), normal.cost, np.inf))

    def retract(self, state: _Placed, step: Array) -> _Placed:
        """exp(δ) R, t + δ."""
        return _Placed(rotations.exp(step[:, :3]) @ state.rotations, state.translations + step[:, 3:])


def _rows(
    turned: Array, predicted: Array, residual: Array, inverse: Array, root: Array | None
) -> tuple[Array, Array]:
    """Residuals (V, 2 N) and their derivatives (V, 6, 2 N), multiplied by the square roots of the weights (V, N),
    None = 1.

    From R x over the depth (V, 3, N), predictions and residuals (V, 2, N), and inverse depths (V, N).
    """
    x, y, z = (turned[:, i] for i in range(3))
    u, v = predicted[:, 0], predicted[:, 1]
    j = np.empty((len(inverse), 6, 2, inverse.shape[1]))
    j[:, 0, 0], j[:, 0, 1] = -u * y, -z - v * y
    j[:, 1, 0], j[:, 1, 1] = z + u * x, v * x
    j[:, 2, 0], j[:, 2, 1] = -y, x
    j[:, 3:5] = 0.0
    j[:, 3, 0] = j[:, 4, 1] = inverse
    np.multiply(predicted, -inverse[:, None], out=j[:, 5])
    if root is not None:
        j *= root[:, None, None]
        residual = residual * root[:, None]
    return residual.reshape(len(j), -1), j.reshape(len(j), 6, -1)
