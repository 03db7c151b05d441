"""The adjustment behind `wand`: cameras, their relative poses, and a bar of known length at every instant.

A bar is a point X and a unit vector d (five unknowns); its markers are at X + p_i d, p_i known. The bars are eliminated
from the normal equations, as points are from a bundle adjustment.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from camcal.geometry import rotations
from camcal.least_squares.blocks import BlockNormal, Fitted, minimise
from camcal.model.camera import Camera
from camcal.model.pose import Array, Pose
from camcal.records import dataclass
from camcal.routes.line_geometry import tangents


@dataclass(frozen=True)
class Sightings:
    """Images of the markers of a bar, sorted by instant.

    Attributes
    ----------
    camera, instant, marker : (N,) int arrays
    uv : (N, 2) array, px
    places : (M,) array
        Positions of the markers along the bar, in the unit of the bar.
    """

    camera: Array
    instant: Array
    marker: Array
    uv: Array
    places: Array

    def __len__(self) -> int:
        return len(self.camera)

    def take(self, rows: Array) -> Sightings:
        """Select some images (a mask or indices)."""
        return replace(
            self,
            camera=self.camera[rows],
            instant=self.instant[rows],
            marker=self.marker[rows],
            uv=self.uv[rows],
        )


@dataclass(frozen=True)
class Wand:
    """Cameras, cam_from_rig of each (the first is the identity), and the bars (T, 3) and (T, 3); NaN where unknown."""

    cameras: tuple[Camera, ...]
    poses: tuple[Pose, ...]
    points: Array
    directions: Array

    @property
    def known(self) -> Array:
        """Which instants (T,) have a bar."""
        return np.isfinite(self.points).all(1)

    def residuals(self, seen: Sightings) -> Array:
        """Predicted - observed (N, 2), px; NaN where a bar is unknown or a marker outside a lens's domain."""
        xyz = self.markers(seen)
        out = np.full((len(seen), 2), np.nan)
        for index, (camera, pose) in enumerate(zip(self.cameras, self.poses, strict=True)):
            own = (seen.camera == index) & np.isfinite(xyz).all(1)
            out[own] = camera.project(pose.apply(xyz[own])) - seen.uv[own]
        return out

    def markers(self, seen: Sightings) -> Array:
        """The position of the marker of each image (N, 3)."""
        along = seen.places[seen.marker][:, None] * self.directions[seen.instant]
        return np.asarray(self.points[seen.instant] + along)


def adjust(
    start: Wand, seen: Sightings, frees: tuple[Array, ...], scale: float | None = None, iterations: int = 60
) -> Fitted[Wand] | None:
    """Minimise Σ |r|² over the free parameters of the cameras, their poses except the first, and the bars.

    Parameters
    ----------
    seen : Sightings
        Of known bars only.
    frees : tuple of (P, F) arrays
        d parameters / d free parameters of each camera.
    scale : float, optional
        px; scale of the Cauchy loss; least squares by default.
    """
    problem = _Problem(start, seen, frees, scale)
    return minimise(problem.linearise, problem.moved, start, iterations)


class _Problem:
    """Columns: the free parameters of all cameras, then six for the pose of each camera except the first."""

    def __init__(self, start: Wand, seen: Sightings, frees: tuple[Array, ...], scale: float | None):
        self.seen, self.frees, self.scale = seen, frees, scale
        self.begins = np.cumsum([0, *(f.shape[1] for f in frees)])
        self.size = int(self.begins[-1]) + 6 * (len(frees) - 1)
        self.bars = np.flatnonzero(np.bincount(seen.instant, minlength=len(start.points)))
        place = np.full(len(start.points), -1)
        place[self.bars] = np.arange(len(self.bars))
        self.bar = place[seen.instant]

    def linearise(self, wand: Wand) -> BlockNormal | None:
        seen, count = self.seen, len(self.seen)
        xyz, across = wand.markers(seen), tangents(wand.directions)[seen.instant]
        residual = np.empty((count, 2))
        shared, own = np.zeros((count, 2, self.size)), np.zeros((count, 2, 5))
        for index, (camera, pose) in enumerate(zip(wand.cameras, wand.poses, strict=True)):
            rows = np.flatnonzero(seen.camera == index)
            turned = xyz[rows] @ pose.rotation.T
            projected, d_xyz, d_params, valid = camera.lens.jacobians(
                camera.params, turned + pose.translation
            )
            if not valid.all():
                return None
            residual[rows] = projected - seen.uv[rows]
            begin, end = self.begins[index], self.begins[index + 1]
            shared[rows, :, begin:end] = d_params @ self.frees[index]
            if index:
                at = self.begins[-1] + 6 * (index - 1)
                shared[rows, :, at : at + 6] = np.concatenate([-d_xyz @ rotations.skew(turned), d_xyz], 2)
            by_point = d_xyz @ pose.rotation
            own[rows, :, :3] = by_point
            own[rows, :, 3:] = by_point @ across[rows] * seen.places[seen.marker[rows]][:, None, None]
        return self._normal(residual, shared, own)

    def _normal(self, residual: Array, shared: Array, own: Array) -> BlockNormal:
        cost = None
        if self.scale is not None:
            squares = np.square(residual).sum(1) / self.scale**2
            cost = 0.5 * self.scale**2 * float(np.log1p(squares).sum())
            root = 1 / np.sqrt(1 + squares)
            residual = residual * root[:, None]
            shared, own = shared * root[:, None, None], own * root[:, None, None]
        made = BlockNormal.of_groups(
            residual.ravel(),
            shared.reshape(-1, self.size),
            own.reshape(-1, 5),
            np.repeat(self.bar, 2),
            len(self.bars),
        )
        return made if cost is None else replace(made, cost=cost)

    def moved(self, wand: Wand, step: Array, own: Array) -> Wand:
        cameras = tuple(
            replace(c, params=c.params + f @ step[a:b])
            for c, f, a, b in zip(wand.cameras, self.frees, self.begins, self.begins[1:], strict=False)
        )
        steps = step[self.begins[-1] :].reshape(-1, 6)
        poses = (wand.poses[0], *(p.moved(s) for p, s in zip(wand.poses[1:], steps, strict=True)))
        points, directions = wand.points.copy(), wand.directions.copy()
        points[self.bars] += own[:, :3]
        d = directions[self.bars] + np.einsum("bik,bk->bi", tangents(directions[self.bars]), own[:, 3:])
        directions[self.bars] = d / np.linalg.norm(d, axis=1, keepdims=True)
        return Wand(cameras, poses, points, directions)
