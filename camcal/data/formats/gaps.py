"""The differences between the cameras of two files."""

from __future__ import annotations

from typing import Any

import numpy as np

from camcal.data.formats.base import CameraFile, NamedCamera
from camcal.model.pose import Pose
from camcal.records import dataclass

#: columns and rows of the pixels over which two cameras are compared, the outermost ones on the border
GRID = (41, 31)


@dataclass(frozen=True)
class Gap:
    """The distance between cameras: the largest over the image, px, and between the poses.

    `shift` is relative to the largest distance between cameras.
    """

    max_px: float
    rotation: float = 0.0
    shift: float = 0.0


def difference(a: Any, b: Any) -> float:
    """The largest distance, px, between two cameras' projections of the rays of the first one's pixels; inf if
    there are none.
    """
    width, height = a.image_size or (2 * a.params[2] + 1, 2 * a.params[3] + 1)
    u, v = np.meshgrid(np.linspace(0, width - 1, GRID[0]), np.linspace(0, height - 1, GRID[1]))
    pixels = np.c_[u.ravel(), v.ravel()]
    rays, seen = a.lens.unproject(a.params, pixels)
    if not seen.any():
        return float("inf")
    again, valid = b.lens.project(b.params, rays[seen])
    return float(np.abs(again - pixels[seen]).max()) if valid.all() else float("inf")


def gap(a: CameraFile, b: CameraFile) -> Gap:
    """The largest differences between the cameras of two files, in their order."""
    px = max(difference(x.camera, y.camera) for x, y in zip(a.cameras, b.cameras, strict=True))
    if not (a.has_poses and b.has_poses) or len(a.cameras) < 2:
        return Gap(px)
    ours, theirs = relative(a.cameras), relative(b.cameras)
    size = max(float(np.linalg.norm(p.translation)) for p in ours) or 1.0
    turn = max(float(np.abs(p.rotation - q.rotation).max()) for p, q in zip(ours, theirs, strict=True))
    shift = max(
        float(np.linalg.norm(p.translation - q.translation)) for p, q in zip(ours, theirs, strict=True)
    )
    return Gap(px, turn, shift / size)


def relative(cameras: tuple[NamedCamera, ...]) -> list[Pose]:
    """The pose of each camera from the frame of the first one."""
    poses = [c.pose for c in cameras if c.pose is not None]
    first = poses[0].inverse()
    return [pose @ first for pose in poses]
