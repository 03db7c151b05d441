"""Initial poses relative to a known camera."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camcal.data.observations import View
from camcal.data.shape import shapes
from camcal.geometry.projective import FLAT_RAY
from camcal.model.camera import Camera
from camcal.model.pose import Array, Pose, Poses
from camcal.start import absolute_pose, shape
from camcal.start.pose import initial_poses

#: points in space that determine a pose with a known camera: three leave up to four poses, a fourth decides
LEAST = 4


def start_poses(camera: Camera, views: Sequence[View]) -> Poses:
    """cam_from_board of each view from the rays of its points, in closed form.

    Points outside the lens's domain, and those seen at nearly 90 degrees to the axis or beyond, are
    omitted, because normalised coordinates x/z cannot represent them. If a view has fewer points in space than a
    projection matrix needs, the absolute pose solver is used.

    Raises
    ------
    DataError
        If a view has too few points, or all are collinear.
    """
    kept, ab, rays = [], [], []
    for view in views:
        d = camera.unproject(view.uv)
        with np.errstate(invalid="ignore"):
            ahead = d[:, 2] > FLAT_RAY  # False also for NaN
        kept.append(view.take(ahead))
        rays.append(d[ahead])
        ab.append(d[ahead, :2] / d[ahead, 2:])
    few = few_in_space(kept)
    found: dict[int, Pose] = {int(i): _best(kept[i], rays[i], ab[i]) for i in np.flatnonzero(few)}
    rest = np.flatnonzero(~few)
    if len(rest):
        poses = initial_poses(
            [kept[i].xyz for i in rest], [ab[i] for i in rest], [kept[i].sigma for i in rest]
        )
        found |= {int(i): pose for i, pose in zip(rest, poses, strict=True)}
    return Poses.stack([found[i] for i in range(len(kept))])


def few_in_space(views: Sequence[View]) -> Array:
    """Mask (V,) of the views with enough points in space for a pose but too few for a projection matrix.

    `LEAST` are enough; fewer always lie on a plane.
    """
    counts = np.array([len(v) for v in views])
    return np.asarray(~shapes(views).planar & (counts < shape.LEAST_3D))


def _best(view: View, rays: Array, ab: Array) -> Pose:
    """The candidate with the smallest error in normalised coordinates."""

    def error(pose: Pose) -> float:
        x = pose.apply(view.xyz)
        with np.errstate(all="ignore"):
            off = np.square(x[:, :2] / x[:, 2:] - ab).sum()
        return float(off) if (x[:, 2] > 0).all() and np.isfinite(off) else float("inf")

    candidates = list(absolute_pose.candidates(view.xyz, rays, None))
    if not candidates:
        raise shape.behind_camera(view.id, len(view), len(view))
    return min(candidates, key=error)
