"""Poses of a target in front of a camera at which all of it is in the picture."""

from __future__ import annotations

import numpy as np

from camcal.errors import DataError
from camcal.geometry import rotations
from camcal.geometry.neighbours import spacing
from camcal.geometry.numbers import TINY
from camcal.geometry.picture import in_picture
from camcal.model.camera import Camera
from camcal.model.placement import AWAY, STEP_RANGE, Spread
from camcal.model.pose import Poses
from camcal.solve.calibration import Calibration
from camcal.solve.common_points import common_points

Array = np.ndarray

#: poses that can be held by hand and detected; corners blur close to the camera and at grazing angles
SPREAD = Spread(tilt=(0.0, 50.0), fill=(0.25, 0.9), roll=90.0, margin=0.01)
#: perturbation of a pose in search of a better one: rotation, radians, and shift relative to the distance
MOVE = (0.15, 0.08)
#: images of the target whose mean distance is below this fraction of the picture's diagonal repeat one view
SAME_VIEW = 0.03
#: largest irregularity and bend of a grid, relative to the distance between its points
UNEVEN = 0.2
#: steps of the fit of distance and position: each removes most of the error
_FITS = 25
#: fraction of the way to the picture's middle by which a target that is not fully visible is moved per step
_INWARDS = 0.2
#: points: a grid of 2 x 2
_LEAST_GRID = 4
#: grid positions per point: points that occupy less than a quarter of the positions are not a grid
_MOST_PLACES = 4
#: largest ratio of the number of all points to that of the fullest view: with more, no view can show all
_MOST_PARTS = 4


class Candidates:
    """Candidate poses of a target.

    Parameters
    ----------
    solution : Calibration
        Its camera and target are used.
    planar : bool
        Whether the target is flat; otherwise it is oriented as in the first view, and then tilted.
    """

    def __init__(self, solution: Calibration, planar: bool):
        self.camera: Camera = solution.camera
        self.points = target_points(solution)
        around = surround(self.points)
        self.edge = around if len(around) else self.points
        self.base: Array = np.eye(3) if planar else solution.poses.rotations[0]
        assert self.camera.image_size is not None
        self.size = np.array(self.camera.image_size, float)

    def spread(self, count: int, rng: np.random.Generator) -> Poses:
        """At most `count` poses over the whole picture, tilts and sizes; fewer if the lens does not see them all.

        Raises
        ------
        DataError
            If no pose shows the whole target.
        """
        azimuth, roll = rng.uniform(-np.pi, np.pi, count), rng.uniform(-1, 1, count) * np.radians(SPREAD.roll)
        tilt, fill = np.radians(rng.uniform(*SPREAD.tilt, count)), rng.uniform(*SPREAD.fill, count)
        none = np.zeros(count)
        lean = rotations.exp(tilt[:, None] * np.c_[np.cos(azimuth), np.sin(azimuth), none])
        turned = lean @ rotations.exp(np.c_[none, none, roll]) @ self.base
        placed = self._placed(turned, rng.uniform(-0.5, self.size - 0.5, (count, 2)), fill)
        placed = placed[self.allowed(placed)]
        if not len(placed):
            raise DataError(
                "no pose was found that shows the whole target to this camera.",
                "Check with `camcal report` whether the lens model is valid over the whole picture.",
            )
        return placed

    def _placed(self, turned: Array, pixels: Array, fill: Array) -> Poses:
        """The target at pixels (K, 2), at the distance that gives the requested size, moved into the picture."""
        offset, low = self.points.mean(0), SPREAD.margin * self.size - 0.5
        high = self.size - 1 - low
        extent = float(np.linalg.norm(self.edge - offset, axis=1).max())
        distance = np.full(len(turned), 3 * extent)
        poses = Poses(turned, np.zeros((len(turned), 3)))
        for _ in range(_FITS):
            rays = self.camera.unproject(pixels)
            facing = rotations_onto(np.nan_to_num(rays)) @ turned
            poses = Poses(facing, rays * distance[:, None] - facing @ offset)
            uv = self.images(poses, self.edge)
            first, last = uv.min(1), uv.max(1)
            seen = np.isfinite(first).all(1)
            ratio = np.where(seen, ((last - first) / self.size).max(1) / fill, AWAY)
            distance = distance * np.clip(ratio, *STEP_RANGE)
            lack = np.maximum(low - first, 0) - np.maximum(last - high, 0)
            to_middle = _INWARDS * ((self.size - 1) / 2 - pixels)
            pixels = pixels + np.where(seen[:, None], lack, to_middle)
        return poses

    def around(self, poses: Poses, rng: np.random.Generator, scale: float) -> Poses:
        """Randomly perturbed poses, by `scale` times MOVE; only those within the limits."""
        turn, shift = (rng.normal(0, scale * s, (len(poses), 3)) for s in MOVE)
        offset = self.points.mean(0)
        centres = poses.rotations @ offset + poses.translations
        turned = rotations.exp(turn) @ poses.rotations
        centres = centres + shift * np.linalg.norm(centres, axis=1, keepdims=True)
        moved = Poses(turned, centres - turned @ offset)
        return moved[self.allowed(moved)]

    def allowed(self, poses: Poses) -> Array:
        """Mask (K,) of the poses that keep the target in the picture, within the limits of tilt and size."""
        uv = self.images(poses, self.edge)
        low, high = uv.min(1), uv.max(1)
        inside = in_picture(np.stack([low, high], 1), self.size, SPREAD.margin * self.size).all(1)
        fill = ((high - low) / self.size).max(1)
        centres = poses.rotations @ self.points.mean(0) + poses.translations
        normals = poses.rotations @ self.base[2]  # the axis that faced the camera before the tilt
        steep = np.einsum("ki,ki->k", normals, centres) / np.linalg.norm(centres, axis=1)
        upright = steep >= np.cos(np.radians(SPREAD.tilt[1]))
        return np.asarray(inside & upright & (fill <= SPREAD.fill[1]) & (fill >= SPREAD.fill[0]))

    def images(self, poses: Poses, points: Array) -> Array:
        """The images of points (N, 3) in each pose, (K, N, 2) px; NaN where the lens does not see them."""
        xyz = points @ poses.rotations.transpose(0, 2, 1) + poses.translations[:, None]
        return np.asarray(self.camera.project(xyz.reshape(-1, 3)).reshape(len(poses), len(points), 2))

    def unlike(self, poses: Poses, taken: Poses) -> Array:
        """Mask (K,) of the poses that do not repeat one that is already taken."""
        own, others = (self.images(p, self.points) for p in (poses, taken))
        apart = [np.linalg.norm(own - one, axis=2).mean(1) for one in others]
        least = SAME_VIEW * float(np.linalg.norm(self.size))
        return np.all(np.array(apart).reshape(len(taken), len(poses)) >= least, axis=0)


def rotations_onto(rays: Array) -> Array:
    """The smallest rotations (K, 3, 3) that take the z axis to directions (K, 3)."""
    axis = np.cross([0.0, 0.0, 1.0], rays)
    sine = np.linalg.norm(axis, axis=1)
    angle = np.arctan2(sine, rays[:, 2])
    return rotations.exp(axis * (angle / np.maximum(sine, TINY))[:, None])


def target_points(solution: Calibration) -> Array:
    """The points (N, 3) of a complete picture of the target: all of them, or those of the fullest view."""
    common = common_points(solution.observations.views)
    if common is not None and len(common[0]) < _MOST_PARTS * max(len(v) for v in solution.observations.views):
        return common[0]
    return max(solution.observations.views, key=len).xyz


def lattice(points: Array) -> tuple[Array, Array]:
    """Columns x (C,) and rows y (R,) of a grid of points (N, 3), up to a bend or an inaccurate print."""
    gap = UNEVEN * spacing(points)
    return _levels(points[:, 0], gap), _levels(points[:, 1], gap)


def _levels(values: Array, gap: float) -> Array:
    """The means of groups of values in which neighbours are within `gap`."""
    values = np.sort(values)
    return np.array([g.mean() for g in np.split(values, np.flatnonzero(np.diff(values) > gap) + 1)])


def surround(points: Array) -> Array:
    """The outline (K, 3) of a flat grid extended by one cell on each side; empty if there is no flat grid.

    A checkerboard's outermost corners are found only if the squares beyond them are in the picture.
    """
    if len(points) < _LEAST_GRID or np.ptp(points[:, 2]) > UNEVEN * spacing(points):
        return np.zeros((0, 3))
    columns, rows = lattice(points)
    places = len(columns) * len(rows)
    if len(columns) < 2 or len(rows) < 2 or not len(points) <= places <= _MOST_PLACES * len(points):
        return np.zeros((0, 3))
    x, y = (np.r_[c[0] - np.diff(c)[0], c, c[-1] + np.diff(c)[-1]] for c in (columns, rows))
    sides = [np.c_[x, np.full(len(x), edge)] for edge in (y[0], y[-1])]
    sides += [np.c_[np.full(len(y), edge), y] for edge in (x[0], x[-1])]
    flat = np.concatenate(sides)
    return np.c_[flat, np.full(len(flat), points[:, 2].mean())]
