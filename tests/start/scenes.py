"""Exact and noisy scenes of a pinhole camera, with their truth."""

from dataclasses import dataclass

import numpy as np

from camcal.data.observations import Correspondences
from camcal.geometry import rotations
from camcal.model.pose import Poses

K = np.array([[1000.0, 0.7, 652.0], [0.0, 1010.0, 391.0], [0.0, 0.0, 1.0]])
K_NO_SKEW = K * np.array([[1, 0, 1], [1, 1, 1], [1, 1, 1]])
SIZE = (1280, 800)
SQUARE = np.array([[1000.0, 0, 639.5], [0, 1000, 399.5], [0, 0, 1]])  #: square pixels, the image's centre


@dataclass(frozen=True)
class Scene:
    observations: Correspondences
    matrix: np.ndarray
    poses: Poses


def board(columns=9, rows=6, square=0.03):
    x, y = np.meshgrid(np.arange(columns) * square, np.arange(rows) * square)
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], 1)


def rig(count=30, seed=7):
    return np.random.default_rng(seed).uniform(-0.15, 0.15, (count, 3))


def seen(matrix, pose, xyz):
    x = pose.apply(xyz) @ matrix.T
    return x[:, :2] / x[:, 2:]


def scene(points, turns, matrix=K, noise=0.0, seed=0, distance=0.6):
    """Views of `points` (N, 3), each turned by a rotation vector about their middle, `distance` away."""
    random = np.random.default_rng(seed)
    r = rotations.exp(np.atleast_2d(turns))
    place = np.array([0.0, 0.0, distance]) + random.uniform(-0.05, 0.05, (len(r), 3))
    poses = Poses(r, place - r @ points.mean(0))
    views = []
    for pose in poses:
        uv = seen(matrix, pose, points)
        views.append((points, uv + noise * random.normal(size=uv.shape)))
    return Scene(Correspondences.from_views(views, image_size=SIZE), matrix, poses)


def tilts(count=8, angle=0.5, spin=0.3, seed=3):
    """Rotation vectors that tilt a board by `angle` about evenly spread axes in its plane."""
    a = np.arange(count) * 2.4 + 0.3
    axis = np.stack([np.cos(a), np.sin(a), np.zeros(count)], 1)
    spins = np.random.default_rng(seed).uniform(-spin, spin, count)
    return rotations.log(rotations.exp(axis * angle) @ rotations.exp(np.outer(spins, [0.0, 0.0, 1.0])))


def pose_error(found, truth):
    """Largest angle, rad, and largest distance between two sets of poses."""
    return (
        rotations.angle_between(found.rotations, truth.rotations).max(),
        np.linalg.norm(found.translations - truth.translations, axis=1).max(),
    )
