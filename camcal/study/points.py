"""Observations with a known truth, of boards and of 3D rigs."""

from __future__ import annotations

import numpy as np

from camcal.data.observations import Observations, View
from camcal.geometry.picture import in_picture
from camcal.model.camera import Camera
from camcal.model.pose import Poses

Array = np.ndarray

OUTLIER_PX = (5.0, 60.0)  #: displacement of gross outliers, px: wrong matches, not inaccurate measurements


def simulate_points(
    camera: Camera,
    points: Array,
    poses: Poses,
    rng: np.random.Generator,
    noise: float = 0.0,
    outliers: float = 0.0,
    clip: bool = True,
    names: list[str] | None = None,
) -> Observations:
    """Project points from each pose and add noise.

    Points outside the lens's domain are omitted from their view.

    Parameters
    ----------
    camera : Camera
    points : (N, 3) array
    poses : Poses
        cam_from_points.
    rng : Generator
    noise : float
        Standard deviation of each coordinate, px.
    outliers : float
        Fraction of the points, 0 to 1, displaced by 5 to 60 px in random directions.
    clip : bool
        Also omit points outside the picture.
    names : list of str, optional
        Names of the views; view01, view02, ... by default.
    """
    digits = max(2, len(str(len(poses))))
    names = names or [f"view{i + 1:0{digits}d}" for i in range(len(poses))]
    size = camera.image_size
    assert size is not None or not clip
    views = []
    for name, pose in zip(names, poses, strict=True):
        uv = camera.project(pose.apply(points))
        seen = np.flatnonzero(in_picture(uv, size) if size is not None and clip else np.isfinite(uv).all(-1))
        uv = uv[seen] + noise * rng.normal(size=(len(seen), 2))
        uv += outlier_moves(len(seen), outliers, rng)
        views.append(View(name, points[seen], uv, point_ids=seen))
    return Observations.from_views(views, camera.image_size)


def outlier_moves(count: int, part: float, rng: np.random.Generator) -> Array:
    """Displacements (count, 2) in px: zero except for `part` of the rows."""
    moves = np.zeros((count, 2))
    chosen = rng.choice(count, round(part * count), replace=False)
    angle, length = rng.uniform(0, 2 * np.pi, len(chosen)), rng.uniform(*OUTLIER_PX, len(chosen))
    moves[chosen] = length[:, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    return moves


def corner_rig(cells: int = 6, spacing: float = 30.0) -> Array:
    """Points (3 cells², 3) on the three inner faces of a cube's corner, the usual 3D calibration rig.

    The grids start half a cell from the edges, so that no point belongs to two faces; z is up.
    """
    a, b = (
        g.ravel() for g in np.meshgrid((np.arange(cells) + 0.5) * spacing, (np.arange(cells) + 0.5) * spacing)
    )
    zero = np.zeros_like(a)
    return np.concatenate([np.c_[a, b, zero], np.c_[a, zero, b], np.c_[zero, a, b]])


def facing_corner() -> Array:
    """The rotation (3, 3) of a camera that looks into the corner of a cube, z up: cam_from_rig."""
    forward = -np.ones(3) / np.sqrt(3)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(forward, right), forward])
