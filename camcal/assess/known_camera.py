"""A known camera judged on data: its parameters stay, the pose of each view is fitted anew."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from camcal.data.observations import Correspondences, View
from camcal.errors import DataError
from camcal.model.camera import Camera
from camcal.model.pose import Array, Poses
from camcal.solve import ransac
from camcal.solve import robust as robustly
from camcal.solve.solution import Solution
from camcal.solve.solve import refine
from camcal.start.pose import initial_poses

#: rays closer to the camera's own plane than this (z of the unit ray) are no start for a pose
_FLAT_RAY = 0.05


def evaluate(
    camera: Camera, correspondences: Correspondences, robust: str = "none", seed: int = 0
) -> Solution:
    """Fit the pose of each view to a camera that stays as it is.

    Parameters
    ----------
    camera : Camera
    correspondences : Correspondences
        Data that the camera was not calibrated with, or it judges itself.
    robust : str
        How outliers are treated, as in a calibration.
    seed : int

    Returns
    -------
    Solution
        With the given camera; residuals, poses and fit are of these data.

    Raises
    ------
    DataError
        Where the pictures are of another size than the camera's, or a view's points leave its pose open.
    """
    _check_size(camera, correspondences)
    held = dict.fromkeys(camera.lens.names)

    def begin(data: Correspondences, masks: Sequence[Array] | None) -> tuple[Correspondences, Camera, Poses]:
        views = data.views if masks is None else [v.take(m) for v, m in zip(data.views, masks, strict=True)]
        return data, camera, start_poses(camera, views)

    def fit(start: Camera, poses: Poses, correspondences: Correspondences, **more: Any) -> Solution:
        return refine(start, poses, correspondences, held, **more)

    agree = partial(ransac.of_poses, camera=camera, seed=seed)
    return robustly.estimate(correspondences, begin, fit, agree, robust, seed)


def start_poses(camera: Camera, views: Sequence[View]) -> Poses:
    """cam_from_board of each view from the rays of its points, in closed form.

    Points outside the lens's domain, and those seen at almost a right angle to the axis or beyond, are left
    out: normalised coordinates x/z do not hold them.
    """
    kept, ab = [], []
    for view in views:
        rays = camera.unproject(view.uv)
        with np.errstate(invalid="ignore"):
            ahead = rays[:, 2] > _FLAT_RAY  # False also for NaN
        kept.append(view.take(ahead))
        ab.append(rays[ahead, :2] / rays[ahead, 2:])
    return initial_poses([v.xyz for v in kept], ab, [v.sigma for v in kept])


def _check_size(camera: Camera, correspondences: Correspondences) -> None:
    ours, theirs = camera.image_size, correspondences.image_size
    if ours is not None and theirs is not None and tuple(ours) != tuple(theirs):
        raise DataError(
            f"the camera is for pictures of {ours[0]}x{ours[1]}, these are of {theirs[0]}x{theirs[1]}.",
            "Pictures as the camera was calibrated with are needed.",
        )
