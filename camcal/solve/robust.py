"""Estimation with outliers: reweighting by a loss, rejection by a test, repeated pose estimation.

Each function takes a fit and returns another one. `camcal.plan` determines which of them are applied, and in which
order.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from camcal.data.observations import OUTSIDE, Observations
from camcal.errors import UsageError
from camcal.model.pose import Array, Pose, Poses
from camcal.registry import suggestion
from camcal.solve import outliers, ransac
from camcal.solve.calibration import Calibration, Estimate
from camcal.solve.losses import LOSSES, Loss, robust_sigma
from camcal.solve.refine import E, How, as_designed, refine, refit

#: what `--robust` takes
METHODS = ("none", "auto", *(name for name in LOSSES if name != "linear"))
#: rejection that has not converged after so many rounds alternates between a few points
ROUNDS = 20
#: weights that change by less than this have converged; 1e-7 of a weight changes no printed digit
SETTLED = 1e-7
#: the pose of views that lost more of their points than the median view, by this fraction, is searched again ...
MUCH = 0.15
#: ... and replaced if another one explains this many times the points
GAIN = 1.1


def check_method(method: str) -> None:
    """Raise a UsageError for a method that is not in `METHODS`."""
    if method not in METHODS:
        raise UsageError(
            f"unknown robust method '{method}'.",
            suggestion(method, METHODS) or "Known: " + ", ".join(METHODS),
        )


def spread(calibration: Estimate) -> float:
    """The median length of all residuals, in px or given sigmas; of two fits to contaminated points, the smaller
    is better.

    Points that a fit does not project have infinite residuals, so that excluding points is no advantage.
    """
    return float(np.median(calibration.observations.standardised(calibration.residuals)))


def reweight(calibration: E, how: How, loss: Loss, rounds: int = 60) -> E:
    """Iteratively reweighted least squares from a fit, on all points, σ following the residuals.

    Stops when the weights no longer change; the observations hold them.
    """
    weights: Array | None = None
    current = calibration
    for _ in range(rounds):
        data = as_designed(current)
        lengths = data.standardised(current.residuals)
        sigma = robust_sigma(lengths, current.free_count)
        fresh = loss.weights(lengths, sigma)
        if weights is not None and np.abs(fresh - weights).max() < SETTLED:
            break
        weights = fresh
        # a point outside the lens's domain has no residual and is not used
        data = replace(data, weight=weights).with_used(np.isfinite(lengths), OUTSIDE)
        current = refit(current, data, how)
    return replace(current, fit=replace(current.fit, loss=loss.name))


def reject(calibration: E, how: How) -> E:
    """Reject by `outliers.test` and refit without loss weights, until no point changes status."""
    current, seen = calibration, set()
    for _ in range(ROUNDS):
        verdict = outliers.test(current)
        key = verdict.used.tobytes()
        if key in seen:
            break
        seen.add(key)
        data = replace(as_designed(current), weight=None).with_used(verdict.used)
        poses = current.poses
        if verdict.bad_views:
            poses = poses[data.views_left(verdict.bad_views)]
            data = data.without(_reasons(current, verdict.bad_views))
            seen.clear()
        elif current.observations.weight is None and np.array_equal(current.used, verdict.used):
            break  # this is that fit already
        current = refit(current, data, how, poses)
    return current


def _reasons(calibration: Estimate, bad: tuple[int, ...]) -> dict[int, str]:
    """The reasons for rejecting whole pictures, by the index of their block."""
    data = calibration.observations
    lengths = data.standardised(calibration.residuals)
    usual = np.median(lengths)
    medians = [np.median(lengths[data.slices[i]]) for i in bad]
    return {
        i: f"does not fit the other views: median residual {m:.3g} against {usual:.3g}"
        for i, m in zip(bad, medians, strict=True)
    }


def with_poses(
    calibration: Calibration, found: dict[int, tuple[Pose, Array]], data: Observations, how: How
) -> Calibration:
    """A fit to the views of `data` that have a pose and a mask (N,) of their points; other views are rejected."""
    used = np.zeros(data.point_count, bool)
    for i, (_, mask) in found.items():
        used[data.slices[i]] = mask
    lost = "no pose with respect to the camera of the other views fits its points"
    left_out = {i: lost for i in range(len(data)) if i not in found}
    poses = Poses.stack([found[i][0] for i in sorted(found)])
    return refine(calibration.camera, poses, data.with_used(used).without(left_out), how)


def find_poses(calibration: Calibration, data: Observations, how: How, seed: int) -> Calibration:
    """A fit to all views of `data` for which RANSAC finds a pose with respect to the camera fitted to some of
    them.
    """
    agreed = ransac.of_poses(data.views, calibration.camera, seed)
    found = {i: (_pose(a.matrix), a.mask) for i, a in enumerate(agreed) if a.matrix is not None}
    return with_poses(calibration, found, data, how)


def find_better_poses(
    calibration: Calibration, data: Observations, how: How, seed: int
) -> Calibration | None:
    """A fit with new poses of views that lost many points or were rejected; None if RANSAC finds none.

    Parameters
    ----------
    calibration : Calibration
        After rejections.
    data : Observations
        All views, including those that the fit rejected.
    """
    verdict, fitted = outliers.test(calibration), calibration.observations
    lost = 1 - fitted.per_block(fitted.used) / fitted.blocks.counts
    much = float(np.median(lost)) + MUCH
    at = {name: i for i, name in enumerate(fitted.view_ids)}
    used = fitted.split(fitted.used)
    found: dict[int, tuple[Pose, Array]] = {}
    better = False
    for index, view in enumerate(data.views):
        i = at.get(view.id)
        if i is not None:
            found[index] = (calibration.poses[i], used[i])
        if i is None or lost[i] > much:
            agreed = ransac.of_poses([view], calibration.camera, seed, verdict.sigma)[0]
            least = len(view) / 2 if i is None else GAIN * used[i].sum()
            if agreed.matrix is not None and agreed.mask.sum() > least:
                found[index], better = (_pose(agreed.matrix), agreed.mask), True
    return with_poses(calibration, found, data, how) if better else None


def _pose(matrix: Array) -> Pose:
    return Pose(matrix[:, :3], matrix[:, 3])
