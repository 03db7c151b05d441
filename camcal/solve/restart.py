"""Fits that begin from what agrees by RANSAC: the start of a contaminated calibration, and second looks.

Where half of the views already give a camera, the others get their poses before it: three points and their
rays fix a pose, so that few samples find one, and no view is lost because its homography was.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from camcal.data.observations import Correspondences, SkippedView
from camcal.errors import DataError, EstimationError
from camcal.model.camera import Camera
from camcal.model.pose import Array, Pose, Poses
from camcal.solve import ransac
from camcal.solve.optimizers.base import Options
from camcal.solve.solution import Solution

#: fewer views than this are not tried for a start where all of them give none
_LEAST_VIEWS = 3
#: views that lost more of their points than the median view, by this part, are looked at again
_MUCH = 0.15
#: ... and get another pose where it explains this many times the points
_GAIN = 1.1


class Fit(Protocol):
    """`refine` with the options of the calibration already given."""

    def __call__(
        self,
        start: Camera,
        poses: Poses,
        correspondences: Correspondences,
        *,
        inliers: Sequence[Array] | None = None,
        weights: Sequence[Array] | None = None,
        options: Options | None = None,
    ) -> Solution:
        """Refine from a start."""
        ...


#: closed form: correspondences, masks of the points to use -> correspondences, start, poses
Begin = Callable[[Correspondences, Sequence[Array] | None], tuple[Correspondences, Camera, Poses]]


def from_agreeing(
    correspondences: Correspondences, begin: Begin, fit: Fit, agree: ransac.Agree, seed: int
) -> Solution | None:
    """A fit to the points that agree: of all views, else of the half where they agree best; None without any.

    The other half then gets its poses, and the points that agree, from the camera of the first.
    """
    found = agree(correspondences.views)
    scatter = np.array([a.sigma for a in found])  # NaN, where there are too few points to tell, comes last
    for count in (len(found), max(len(found) // 2, _LEAST_VIEWS)):
        rows = np.sort(np.argsort(scatter, kind="stable")[:count])
        data = replace(correspondences, views=tuple(correspondences.views[i] for i in rows))
        masks = [found[i].mask for i in rows]
        try:
            _, camera, poses = begin(data, masks)
            part = fit(camera, poses, data, inliers=masks)
            return part if len(rows) == len(found) else _with_all_views(part, correspondences, fit, seed)
        except (EstimationError, DataError):
            continue  # the caller says why all points together give no camera
    return None


def _with_all_views(part: Solution, correspondences: Correspondences, fit: Fit, seed: int) -> Solution:
    """A fit to all views that have a pose before the camera of a part of them."""
    agreed = ransac.of_poses(correspondences.views, part.camera, seed)
    found = [None if a.matrix is None else (_pose(a.matrix), a.mask) for a in agreed]
    return _fit_those(correspondences, found, part.camera, fit)


def _pose(matrix: Array) -> Pose:
    return Pose(matrix[:, :3], matrix[:, 3])


def _fit_those(
    correspondences: Correspondences,
    found: Sequence[tuple[Pose, Array] | None],
    camera: Camera,
    fit: Fit,
) -> Solution:
    """A fit from poses and masks; views without any are rejected."""
    views = correspondences.views
    skipped = tuple(
        SkippedView(v.id, "rejected", "no pose before the camera of the other views fits its points")
        for v, f in zip(views, found, strict=True)
        if f is None
    )
    kept = [(v, *f) for v, f in zip(views, found, strict=True) if f is not None]
    data = replace(
        correspondences,
        views=tuple(v for v, _, _ in kept),
        skipped=(*correspondences.skipped, *skipped),
    )
    return fit(camera, Poses.stack([p for _, p, _ in kept]), data, inliers=[m for _, _, m in kept])


def second_look(
    solution: Solution, correspondences: Correspondences, fit: Fit, sigma: float, seed: int
) -> Solution | None:
    """A fit with better poses of views that lost much or were rejected; None where RANSAC finds none.

    Parameters
    ----------
    solution : Solution
        After rejections.
    correspondences : Correspondences
        All views, those included that the solution rejected.
    sigma : float
        The noise of the solution: px, or of the given sigmas where there are some.
    """
    lost = np.array([1 - m.mean() for m in solution.inliers])
    much = float(np.median(lost)) + _MUCH
    at = {v.id: i for i, v in enumerate(solution.correspondences.views)}
    found: list[tuple[Pose, Array] | None] = []
    better = False
    for view in correspondences.views:
        i = at.get(view.id)
        known = None if i is None else (solution.poses[i], solution.inliers[i])
        if i is None or known is None or lost[i] > much:
            agreed = ransac.of_poses([view], solution.camera, seed, sigma)[0]
            kept = len(view) / 2 if known is None else _GAIN * known[1].sum()
            if agreed.matrix is not None and agreed.mask.sum() > kept:
                known, better = (_pose(agreed.matrix), agreed.mask), True
        found.append(known)
    return _fit_those(correspondences, found, solution.camera, fit) if better else None
