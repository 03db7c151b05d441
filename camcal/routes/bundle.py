"""Bundle adjustment: one camera, its poses and the points of the scene, all unknown, by least squares in px.

The points are eliminated from every normal equation (Triggs et al., Bundle adjustment: a modern synthesis, 2000).
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.sparse import csr_array

from camcal.geometry import rotations
from camcal.least_squares.blocks import BlockNormal, Fitted, bounded_inverse, minimise
from camcal.model.camera import Camera
from camcal.model.pose import Array
from camcal.records import dataclass


@dataclass(frozen=True)
class Tracks:
    """Images of scene points.

    Attributes
    ----------
    view, point : (N,) int arrays
    uv : (N, 2) array, px
    """

    view: Array
    point: Array
    uv: Array

    def __len__(self) -> int:
        return len(self.view)

    def take(self, rows: Array) -> Tracks:
        """Select some images (a mask or indices)."""
        return Tracks(self.view[rows], self.point[rows], self.uv[rows])


@dataclass(frozen=True)
class Bundle:
    """A camera, cam_from_world of V views, and points (P, 3) of the world; NaN where unknown."""

    camera: Camera
    rotations: Array
    translations: Array
    points: Array

    @property
    def known_views(self) -> Array:
        """Mask (V,) of the views with a pose."""
        return np.isfinite(self.translations).all(1)

    @property
    def known_points(self) -> Array:
        """Mask (P,) of the points with a position."""
        return np.isfinite(self.points).all(1)

    def residuals(self, tracks: Tracks) -> Array:
        """Predicted - observed (N, 2), px; NaN where view or point is unknown or outside the domain."""
        r, t = self.rotations[tracks.view], self.translations[tracks.view]
        cam = np.einsum("nij,nj->ni", r, np.nan_to_num(self.points[tracks.point])) + t
        found = self.camera.project(np.nan_to_num(cam)) - tracks.uv
        known = self.known_views[tracks.view] & self.known_points[tracks.point]
        return np.where(known[:, None], found, np.nan)


def adjust(
    start: Bundle, tracks: Tracks, free: Array, iterations: int = 60, scale: float | None = None
) -> Fitted[Bundle] | None:
    """Minimise Σ |r|² over the camera's free parameters, the known poses and the known points.

    Parameters
    ----------
    start : Bundle
    tracks : Tracks
        Images of known points in known views only.
    free : (P, F) array
        d parameters / d free parameters.
    scale : float, optional
        px; scale of the Cauchy loss, by which wrong tracks lose their weight; least squares by default.
    """
    problem = _Problem(start, tracks, free, scale)
    return minimise(problem.linearise, problem.moved, start, iterations)


class _Problem:
    """The blocks of the normal equations: poses of the views first, then the camera; points eliminated."""

    def __init__(self, start: Bundle, tracks: Tracks, free: Array, scale: float | None):
        self.tracks = tracks = tracks.take(np.argsort(tracks.view, kind="stable"))
        self.free, self.scale = free, scale
        self.views, begin = np.unique(tracks.view, return_index=True)
        self.points, point = np.unique(tracks.point, return_inverse=True)
        self.rows = [slice(a, b) for a, b in pairwise([*begin.tolist(), len(tracks)])]
        view = np.repeat(np.arange(len(self.views)), np.diff([*begin, len(tracks)]))
        self.cells, cell = np.unique(point * len(self.views) + view, return_inverse=True)
        self.of_points, self.of_cells = _summation(point, len(self.points)), _summation(cell, len(self.cells))

    def linearise(self, bundle: Bundle) -> BlockNormal | None:
        tracks = self.tracks
        turned = np.einsum("nij,nj->ni", bundle.rotations[tracks.view], bundle.points[tracks.point])
        cam = turned + bundle.translations[tracks.view]
        lens, params = bundle.camera.lens, bundle.camera.params
        projected, d_xyz, d_params, valid = lens.jacobians(params, cam)
        if not valid.all():
            return None
        r = projected - tracks.uv
        cost = 0.5 * float((r * r).sum())
        by_pose = np.concatenate([-d_xyz @ rotations.skew(turned), d_xyz], 2)
        by_point, by_camera = d_xyz @ bundle.rotations[tracks.view], d_params @ self.free
        if self.scale is not None:
            squares = (r * r).sum(1) / self.scale**2
            cost = 0.5 * self.scale**2 * float(np.log1p(squares).sum())
            root = 1 / np.sqrt(1 + squares)
            r = r * root[:, None]
            by_pose, by_point, by_camera = (j * root[:, None, None] for j in (by_pose, by_point, by_camera))
        return self._normal(cost, np.concatenate([by_pose, by_camera, by_point, r[..., None]], 2))

    def _normal(self, cost: float, jacobian: Array) -> BlockNormal:
        """The sums of products of the columns (N, 2, 6 + C + 3 + 1): pose, camera, point, residual."""
        v, p, c = len(self.views), len(self.points), self.free.shape[1]
        shared, gradient = np.zeros((6 * v + c, 6 * v + c)), np.zeros(6 * v + c)
        per_view = np.concatenate([jacobian[..., : 6 + c], jacobian[..., -1:]], 2)
        camera, end = slice(6 * v, None), slice(6, 6 + c)
        for i, rows in enumerate(self.rows):
            own = per_view[rows].reshape(-1, 7 + c)
            square, pose = own.T @ own, slice(6 * i, 6 * i + 6)
            shared[pose, pose], shared[pose, camera] = square[:6, :6], square[:6, end]
            shared[camera, camera] += square[end, end]
            gradient[pose] = square[:6, -1]
            gradient[camera] += square[end, -1]
        shared[camera, : 6 * v] = shared[: 6 * v, camera].T
        by_point = jacobian[:, :, 6 + c : 9 + c, None]
        products = sum(by_point[:, k] * jacobian[:, k, None] for k in range(2))  # (N, 3, 10 + C)
        sums = _summed(self.of_points, products[:, :, 6:])
        coupling = np.zeros((p, 6 * v + c, 3))
        poses = np.zeros((p * v, 6, 3))
        poses[self.cells] = np.swapaxes(_summed(self.of_cells, products[:, :, :6]), 1, 2)
        coupling[:, : 6 * v] = poses.reshape(p, 6 * v, 3)
        coupling[:, 6 * v :] = np.swapaxes(sums[:, :, :c], 1, 2)
        return BlockNormal(cost, shared, gradient, coupling, sums[:, :, c : c + 3], sums[:, :, -1])

    def moved(self, bundle: Bundle, shared: Array, own: Array) -> Bundle:
        v = len(self.views)
        steps = shared[: 6 * v].reshape(v, 6)
        r, t, points = bundle.rotations.copy(), bundle.translations.copy(), bundle.points.copy()
        r[self.views] = rotations.exp(steps[:, :3]) @ r[self.views]
        t[self.views] += steps[:, 3:]
        points[self.points] += own
        camera = replace(bundle.camera, params=bundle.camera.params + self.free @ shared[6 * v :])
        return Bundle(camera, r, t, points)


def _summation(index: Array, count: int) -> csr_array:
    """The matrix (count, N) that adds the rows of each index."""
    return csr_array((np.ones(len(index)), (index, np.arange(len(index)))), (count, len(index)))


def _summed(summation: csr_array, values: Array) -> Array:
    return (summation @ values.reshape(len(values), -1)).reshape(-1, *values.shape[1:])


def freedom(tracks: Tracks, free: Array) -> int:
    """The degrees of freedom of the residuals, at least 1; the frame and the scale of the world are free."""
    views = int(np.count_nonzero(np.bincount(tracks.view)))
    points = int(np.count_nonzero(np.bincount(tracks.point)))
    return max(2 * len(tracks) - 3 * points - 6 * views - free.shape[1] + 7, 1)


def camera_covariance(fitted: Fitted[Bundle], tracks: Tracks, free: Array) -> Array:
    """The covariance (P, P) of the camera's parameters.

    The frame and scale of the world are free. They are fixed by holding the first view and the largest coordinate of
    another view's translation, which does not affect the covariance of the camera.
    """
    bundle = fitted.state
    views = np.flatnonzero(np.bincount(tracks.view, minlength=len(bundle.rotations)))
    reduced = fitted.normal.reduced()
    centres = -np.einsum("vji,vj->vi", bundle.rotations[views], bundle.translations[views])
    far = int(np.linalg.norm(centres - centres[0], axis=1).argmax())
    along = bundle.translations[views[far]] - bundle.rotations[views[far]] @ (
        bundle.rotations[views[0]].T @ bundle.translations[views[0]]
    )
    hold = np.zeros(len(reduced), bool)
    hold[:6] = True
    hold[6 * far + 3 + int(np.abs(along).argmax())] = True
    inverse = bounded_inverse(reduced[np.ix_(~hold, ~hold)])
    c = free.shape[1]
    residual = bundle.residuals(tracks)
    variance = float(np.square(residual).sum()) / freedom(tracks, free)
    return free @ inverse[len(inverse) - c :, len(inverse) - c :] @ free.T * variance
