"""Estimation from data that lie: a robust start, reweighting, and rejection by a stated test.

`auto` first fits as if all were well. Only where the residuals speak against that (`outliers.judge`) does it
start again from the points that agree by RANSAC, reweight by a redescending loss, reject and fit the rest by
maximum likelihood, until no point changes sides. Clean data thus get the least squares answer itself, and
pay for one test.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from camcal.errors import UsageError
from camcal.refine import outliers, ransac
from camcal.refine.losses import LOSSES, Loss, robust_sigma
from camcal.refine.optimizers.base import Options
from camcal.registry import suggestion
from camcal.types import Array, Camera, Correspondences, Poses, SkippedView, Solution

#: what `--robust` takes
METHODS = ("none", "auto", *(name for name in LOSSES if name != "linear"))
#: from this share of rejected points on, the least squares fit is no place to start from
_START_AGAIN = 0.02
_ROUNDS = 20


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


def estimate(
    correspondences: Correspondences,
    begin: Begin,
    fit: Fit,
    planar: Sequence[bool],
    method: str = "auto",
    seed: int = 0,
) -> Solution:
    """Calibrate with outliers.

    Parameters
    ----------
    correspondences : Correspondences
    begin : callable
        The closed form on some of the points.
    fit : callable
        The refinement.
    planar : sequence of bool
        Which views hold points of a plane.
    method : str
        One of `METHODS`.
    seed : int
        Of the random samples.

    Returns
    -------
    Solution
        With `inliers`, and with `weights` where a loss was asked for; views rejected as a whole are in its
        correspondences' `skipped`.

    Raises
    ------
    UsageError
        For an unknown method.
    """
    if method not in METHODS:
        raise UsageError(
            f"unknown robust method '{method}'.",
            suggestion(method, METHODS) or "Known: " + ", ".join(METHODS),
        )
    first = fit(*_order(begin(correspondences, None)))
    if method == "none":
        return first
    verdict = _judge(first)
    clean = not verdict.rejected and outliers.looks_gaussian(_standard(first), verdict.sigma)
    if method == "auto" and clean:
        return first
    start = first
    if not clean and verdict.rejected > _START_AGAIN * first.correspondences.point_count:
        start = _start_again(first, begin, fit, planar, seed)
    if method != "auto":
        return reweight(start, fit, LOSSES[method])
    return reject(reweight(start, fit, LOSSES["cauchy"], rounds=_ROUNDS // 2), fit)


def _order(begun: tuple[Correspondences, Camera, Poses]) -> tuple[Camera, Poses, Correspondences]:
    correspondences, camera, poses = begun
    return camera, poses, correspondences


def _start_again(first: Solution, begin: Begin, fit: Fit, planar: Sequence[bool], seed: int) -> Solution:
    """A fit that begins from the points that agree by RANSAC, if its median residual is lower."""
    correspondences = first.correspondences
    masks = ransac.agreeing_views(correspondences.views, planar, seed)
    _, camera, poses = begin(correspondences, masks)
    again = fit(camera, poses, correspondences, inliers=masks)
    return min((again, first), key=lambda s: robust_sigma(np.concatenate(_lengths(s))))


def _judge(solution: Solution) -> outliers.Verdict:
    return outliers.judge(solution.correspondences, solution.residuals, solution.free_count)


def _standard(solution: Solution) -> Array:
    pairs = zip(solution.correspondences.views, solution.residuals, strict=True)
    return np.concatenate([r if v.sigma is None else r / v.sigma[:, None] for v, r in pairs])


def _lengths(solution: Solution) -> list[Array]:
    pairs = zip(solution.correspondences.views, solution.residuals, strict=True)
    return [outliers.standardised(v, r) for v, r in pairs]


def reweight(solution: Solution, fit: Fit, loss: Loss, rounds: int = 60) -> Solution:
    """Iteratively reweighted least squares from a solution, on all points, σ following the residuals.

    Stops where the weights no longer change; `Solution.weights` holds them.
    """
    weights: list[Array] | None = None
    for _ in range(rounds):
        lengths = _lengths(solution)
        sigma = robust_sigma(np.concatenate(lengths), solution.free_count)
        fresh = [loss.weights(length, sigma) for length in lengths]
        if (
            weights is not None
            and max(np.abs(a - b).max() for a, b in zip(fresh, weights, strict=True)) < 1e-7
        ):
            break
        weights = fresh
        whole = [
            w if v.sigma is None else w / v.sigma**2
            for w, v in zip(weights, solution.correspondences.views, strict=True)
        ]
        solution = fit(solution.camera, solution.poses, solution.correspondences, weights=whole)
    fitted = replace(solution.fit, loss=loss.name)
    return replace(solution, weights=None if weights is None else tuple(weights), fit=fitted)


def reject(solution: Solution, fit: Fit, correspondences: Correspondences | None = None) -> Solution:
    """Reject by `outliers.judge` and fit the rest, until no point changes sides.

    `correspondences` are what `fit` is given, where they are not those of the solution (an ideal board, when
    the fit estimates its shape).
    """
    correspondences = correspondences or solution.correspondences
    current, seen = solution, set()
    for _ in range(_ROUNDS):
        verdict = _judge(current)
        key = b"".join(m.tobytes() for m in verdict.inliers)
        if key in seen:
            break
        seen.add(key)
        if verdict.bad_views:
            keep = np.array([i for i in range(len(current.poses)) if i not in verdict.bad_views])
            correspondences = _without(correspondences, current, verdict)
            masks = [verdict.inliers[i] for i in keep]
            seen.clear()
            current = fit(current.camera, current.poses[keep], correspondences, inliers=masks)
        else:
            current = fit(current.camera, current.poses, correspondences, inliers=verdict.inliers)
    return replace(current, weights=None)


def _without(
    correspondences: Correspondences, solution: Solution, verdict: outliers.Verdict
) -> Correspondences:
    """Leave out the views that are rejected as a whole, each with its reason."""
    bad, views, lengths = set(verdict.bad_views), correspondences.views, _lengths(solution)
    usual = np.median(np.concatenate(lengths))
    skipped = tuple(
        SkippedView(
            views[i].id,
            "rejected",
            f"does not fit the other views: median residual {np.median(lengths[i]):.3g} against {usual:.3g}",
        )
        for i in sorted(bad)
    )
    return replace(
        correspondences,
        views=tuple(v for i, v in enumerate(views) if i not in bad),
        skipped=(*correspondences.skipped, *skipped),
    )
