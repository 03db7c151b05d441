"""Points in space from their images in several cameras: least squares in px, outlier rejection, covariances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from camcal.errors import DataError, EstimationError
from camcal.least_squares.blocks import BlockNormal, Fitted, minimise, unit_eigen
from camcal.least_squares.distributions import chi2_quantile
from camcal.model.pose import Array
from camcal.records import dataclass
from camcal.routes.distance import half_width
from camcal.routes.placed import PlacedCamera

#: Rays are parallel if the least singular value of their normal matrix is below this fraction of the largest: the
#: angle between them is then below 1e-6 rad, a thousandth of a pixel for a focal length of 1000 px. The least
#: eigenvalue of a point's normal matrix with unit diagonal is of the order of the same squared angle.
PARALLEL = 1e-12
#: px; smaller residuals are rounding of exact data, never outliers
ROUNDING = 1e-9
#: A point's residuals are noise unless a χ² test at this level rejects it: one good point in a thousand is examined.
LEVEL = 0.999
#: least degrees of freedom of a tested point: without one of its images (two coordinates) it still has one. Points with
#: fewer would be tried in vain: no result depends on it.
LEAST_FREEDOM = 3


@dataclass(frozen=True)
class Images:
    """Image points of several cameras.

    Attributes
    ----------
    camera, point : (N,) int arrays
        Sorted by point.
    uv : (N, 2) array, px
    sigma : (N,) array or None, px
    """

    camera: Array
    point: Array
    uv: Array
    sigma: Array | None = None

    def __len__(self) -> int:
        return len(self.point)


@dataclass(frozen=True)
class Triangulated:
    """Triangulated points with their uncertainties.

    Attributes
    ----------
    xyz : (P, 3) array
        NaN for undetermined points.
    covariance : (P, 3, 3) array
        Scaled by `sigma_hat`.
    residual : (P,) array
        rms_point over the images used, px.
    residuals : (N, 2) array, px
        Of each image, NaN where its point is undetermined.
    used : (N,) bool array
    sigma_hat : float or None
        Of the noise of an image coordinate, px (or of sigma), from the residuals of all points together.
    reason : tuple of str
        Why a point is undetermined; empty if it is determined.
    cameras : tuple of PlacedCamera
        As given, but mirrored if the world's frame is left-handed.
    """

    xyz: Array
    covariance: Array
    residual: Array
    residuals: Array
    used: Array
    sigma_hat: float | None
    reason: tuple[str, ...]
    cameras: tuple[PlacedCamera, ...]

    @property
    def known(self) -> Array:
        """Which points have a position (P,)."""
        return np.array([not r for r in self.reason], bool)


def far_half_widths(found: Triangulated, images: Images) -> Array:
    """Half of the 95 % intervals (P,) of the distances of the points from the camera with the smallest interval,
    relative to the distance; NaN for points without a position.
    """
    freedom = 2 * int(found.used[found.known[images.point]].sum()) - 3 * int(found.known.sum())
    best = np.full(len(found.xyz), np.inf)
    for index, camera in enumerate(found.cameras):
        points = images.point[(images.camera == index) & found.used]
        points = points[found.known[points]]
        offset, own = found.xyz[points] - camera.centre, found.covariance[points]
        best[points] = np.minimum(best[points], half_width(offset, own, max(freedom, 1)))
    return np.where(found.known, best, np.nan)


def triangulate(cameras: Sequence[PlacedCamera], images: Images, count: int) -> Triangulated:
    """Triangulate `count` points.

    Each point is initialised by least squares of the distances from its rays and refined by minimising
    Σ |r|² / sigma². A point whose residuals are too large for the common noise is tried without each of its images
    (if it has three or more); the best such choice is kept if its residuals are noise.

    Raises
    ------
    DataError
        If no point has two images.
    EstimationError
        If no point is determined.
    """
    views = np.bincount(images.point, minlength=count)
    if views.max(initial=0) < 2:
        raise DataError(
            f"none of {count} points is seen by two cameras; triangulation needs two images of a point.",
            "Check the names of the points in the table.",
        )
    cameras = _right_way_round(cameras, images, count)
    used = np.isfinite(_rays(cameras, images)).all(1)
    found = _solve(cameras, images, used, count)
    used = _without_outliers(cameras, images, used, found, count)
    found = _solve(cameras, images, used, count)
    if not found.known.any():
        reason = max(sorted(set(found.reason)), key=found.reason.count)
        raise EstimationError(
            f"none of {count} points is determined; the most frequent reason: {reason}.",
            "Check that the cameras differ, and that the image points are in the pixels of their cameras.",
        )
    return found


def _rays(cameras: Sequence[PlacedCamera], images: Images) -> Array:
    rays = np.full((len(images), 3), np.nan)
    for index, camera in enumerate(cameras):
        rows = images.camera == index
        rays[rows] = camera.rays(images.uv[rows])
    return rays


def _linear(cameras: Sequence[PlacedCamera], images: Images, used: Array, count: int) -> tuple[Array, Array]:
    """Points (P, 3) nearest to their rays, and whether the rays determine them (P,)."""
    xyz, least = linear(cameras, images, used, count)
    return xyz, least > PARALLEL


def linear(cameras: Sequence[PlacedCamera], images: Images, used: Array, count: int) -> tuple[Array, Array]:
    """Points (P, 3) nearest to their rays, NaN if these are parallel, and the smallest eigenvalue (P,) of Σ (I - d
    dᵀ) over the rays d.
    """
    rays = np.nan_to_num(_rays(cameras, images))
    across = (np.eye(3) - rays[:, :, None] * rays[:, None]) * used[:, None, None]
    centres = np.stack([c.centre for c in cameras])[images.camera]
    normal, right = np.zeros((count, 3, 3)), np.zeros((count, 3))
    np.add.at(normal, images.point, across)
    np.add.at(right, images.point, np.einsum("nij,nj->ni", across, centres))
    values = np.linalg.eigvalsh(normal)
    known = values[:, 0] > PARALLEL
    xyz = np.full((count, 3), np.nan)
    xyz[known] = np.linalg.solve(normal[known], right[known][..., None])[..., 0]
    return xyz, values[:, 0]


def _right_way_round(cameras: Sequence[PlacedCamera], images: Images, count: int) -> tuple[PlacedCamera, ...]:
    """Cameras that see most of their points in front; in a left-handed world projection matrices change sign."""
    xyz, _ = _linear(cameras, images, np.isfinite(_rays(cameras, images)).all(1), count)
    out = []
    for index, camera in enumerate(cameras):
        depth = camera.pose.apply(xyz[images.point[images.camera == index]])[:, 2]
        depth = depth[np.isfinite(depth)]
        pinhole = camera.camera.lens.name == "pinhole"
        out.append(camera.mirrored() if pinhole and 2 * (depth < 0).sum() > len(depth) else camera)
    return tuple(out)


def _solve(cameras: Sequence[PlacedCamera], images: Images, used: Array, count: int) -> Triangulated:
    start, known = _linear(cameras, images, used, count)
    seen = np.bincount(images.point[used], minlength=count)
    reason = np.where(seen < 2, "one image", np.where(known, "", "its rays are parallel")).astype(object)
    rows = used & (reason[images.point] == "")
    first, _ = _equations(cameras, images, start)
    lost = np.zeros(count, bool)
    np.logical_or.at(lost, images.point[rows], ~np.isfinite(first[rows]).all(1))
    reason[lost & (reason == "")] = "behind a camera, or outside the domain of its lens"
    rows &= reason[images.point] == ""
    own = np.flatnonzero(reason == "")
    fit = _adjusted(cameras, images, rows, own, start) if len(own) else None
    xyz, covariance = np.full((count, 3), np.nan), np.full((count, 3, 3), np.nan)
    sigma_hat = None
    if fit is not None:
        inverse, determined = _inverses(fit.normal.blocks)
        reason[own[~determined]] = "its rays are parallel"  # the fit moved it to infinity
        rows &= reason[images.point] == ""
        own, inverse = own[determined], inverse[determined]
        xyz[own] = fit.state[own]
    residuals = _equations(cameras, images, xyz)[0]
    if fit is not None and len(own):
        freedom = 2 * int(rows.sum()) - 3 * len(own)
        scale = float(np.square(residuals[rows] * _roots(images)[rows, None]).sum()) / freedom
        sigma_hat = float(np.sqrt(scale))
        covariance[own] = inverse * scale
    squares = np.bincount(images.point[rows], np.square(residuals[rows]).sum(1), count)
    images_used = np.maximum(np.bincount(images.point[rows], minlength=count), 1)
    residual = np.where(reason == "", np.sqrt(squares / images_used), np.nan)
    return Triangulated(xyz, covariance, residual, residuals, used, sigma_hat, tuple(reason), tuple(cameras))


def _roots(images: Images) -> Array:
    """The square roots (N,) of the weights: 1 / sigma."""
    return np.ones(len(images)) if images.sigma is None else 1 / images.sigma


def _inverses(blocks: Array) -> tuple[Array, Array]:
    """The inverses (P, 3, 3) of the normal matrices of points, and whether the rays determine the points (P,)."""
    values, vectors, units = unit_eigen(blocks)
    known = values[:, 0] > PARALLEL
    values = np.where(known[:, None], values, 1.0)
    return (vectors / values[:, None]) @ np.swapaxes(vectors, 1, 2) / units, known


def _equations(cameras: Sequence[PlacedCamera], images: Images, xyz: Array) -> tuple[Array, Array]:
    """Residuals (N, 2), px, of all images and their Jacobians (N, 2, 3) by their points; NaN where undefined."""
    residual, jacobian = np.full((len(images), 2), np.nan), np.full((len(images), 2, 3), np.nan)
    with np.errstate(invalid="ignore"):  # unknown points are NaN
        for index, camera in enumerate(cameras):
            own = images.camera == index
            residual[own], jacobian[own] = camera.residuals(xyz[images.point[own]], images.uv[own])
    return residual, jacobian


def _adjusted(
    cameras: Sequence[PlacedCamera], images: Images, rows: Array, own: Array, start: Array
) -> Fitted[Array] | None:
    """The points of indices `own` where Σ |r|² / sigma² over `rows` (N,) is least, near `start` (P, 3)."""
    place = np.full(len(start), -1)
    place[own] = np.arange(len(own))
    group = np.repeat(place[images.point[rows]], 2)
    weight = np.repeat(_roots(images)[rows], 2)

    def linearise(xyz: Array) -> BlockNormal | None:
        residual, jacobian = _equations(cameras, images, xyz)
        residual, jacobian = residual[rows].ravel(), jacobian[rows].reshape(-1, 3)
        if not np.isfinite(residual).all():
            return None
        shared = np.zeros((len(residual), 0))
        return BlockNormal.of_groups(residual * weight, shared, jacobian * weight[:, None], group, len(own))

    def moved(xyz: Array, _: Array, steps: Array) -> Array:
        out = xyz.copy()
        out[own] += steps
        return out

    return minimise(linearise, moved, start)


def _without_outliers(
    cameras: Sequence[PlacedCamera], images: Images, used: Array, found: Triangulated, count: int
) -> Array:
    """`used` without the images whose removal improves their points."""
    costs, freedom = _costs(images, used, found, count)
    scale = _scale(costs, freedom)
    with np.errstate(invalid="ignore"):
        suspects = (costs > scale * chi2_quantile(LEVEL, np.maximum(freedom, 1))) & (freedom >= LEAST_FREEDOM)
    if not suspects.any():
        return used
    best, choice = np.full(count, np.inf), np.full(count, -1)
    order = _order_within(images.point)
    for nth in range(int(order.max()) + 1):  # omit the n-th image of every suspect point at the same time
        rows = np.flatnonzero((order == nth) & suspects[images.point] & used)
        part = suspects[images.point] & used
        part[rows] = False
        tried = _solve(cameras, images, part, count)
        cost, left = _costs(images, part, tried, count)
        for row in rows:
            point = images.point[row]
            if cost[point] < best[point] and left[point] >= 1:
                best[point], choice[point] = cost[point], row
    good = best <= scale * chi2_quantile(LEVEL, np.maximum(freedom - 2, 1))
    out = used.copy()
    out[choice[good & (choice >= 0)]] = False
    return out


def _costs(images: Images, used: Array, found: Triangulated, count: int) -> tuple[Array, Array]:
    """Σ |r|² / sigma² (P,) of each point, and its degrees of freedom (P,)."""
    squares = np.square(found.residuals).sum(1)
    if images.sigma is not None:
        squares = squares / images.sigma**2
    rows = used & np.isfinite(squares)
    costs = np.bincount(images.point[rows], squares[rows], count)
    freedom = 2 * np.bincount(images.point[rows], minlength=count) - 3
    return np.where(freedom > 0, costs, np.nan), freedom


def _scale(costs: Array, freedom: Array) -> float:
    """The variance of an image coordinate from the median over the points, robust against outliers."""
    known = np.isfinite(costs) & (freedom > 0)
    if not known.any():
        return float("inf")
    return max(float(np.median(costs[known] / chi2_quantile(0.5, freedom[known]))), ROUNDING**2)


def _order_within(point: Array) -> Array:
    """The number of preceding rows of the same point (N,); rows are sorted by point."""
    starts = np.searchsorted(point, point)
    return np.arange(len(point)) - starts


def sorted_images(camera: Array, point: Array, uv: Array, sigma: Array | None = None) -> tuple[Images, Array]:
    """Images sorted by point, and the original index of each (N,).

    Raises
    ------
    DataError
        If a camera has two images of a point.
    """
    order = np.lexsort((camera, point))
    made = Images(camera[order], point[order], uv[order])
    same = (np.diff(made.camera) == 0) & (np.diff(made.point) == 0)
    if same.any():
        rows = order[[int(same.argmax()), int(same.argmax()) + 1]]
        raise DataError(
            f"rows {min(rows) + 1} and {max(rows) + 1} of the table are the same point in the same camera.",
            "One image of a point in each camera is needed.",
        )
    return (made if sigma is None else replace(made, sigma=sigma[order])), order
