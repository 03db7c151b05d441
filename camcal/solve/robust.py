"""Estimation from data that lie: a robust start, reweighting, and rejection by a stated test.

`auto` first fits as if all were well. Only where the residuals speak against that (`outliers.judge`), or
where there is no such fit, does it start again from the points that agree by RANSAC (`restart.py`), reweight
by a redescending loss, reject and fit the rest by maximum likelihood, until no point changes sides. Clean
data thus get the least squares answer itself, and pay for one test.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from camcal.data.observations import Correspondences, SkippedView
from camcal.errors import DataError, EstimationError, UsageError
from camcal.model.pose import Array
from camcal.registry import suggestion
from camcal.solve import outliers, ransac, restart, starts
from camcal.solve.losses import LOSSES, Loss, robust_sigma
from camcal.solve.restart import Begin, Fit
from camcal.solve.solution import Solution

#: what `--robust` takes
METHODS = ("none", "auto", *(name for name in LOSSES if name != "linear"))
#: from this share of rejected points on, the least squares fit is no place to start from
_START_AGAIN = 0.02
_ROUNDS = 20


def estimate(
    correspondences: Correspondences,
    begin: Begin,
    fit: Fit,
    agree: ransac.Agree,
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
    agree : callable
        RANSAC on each view: `ransac.of_maps` or `of_poses` with their options.
    method : str
        One of `METHODS`.
    seed : int
        Of random samples that `agree` does not draw.

    Returns
    -------
    Solution
        With `inliers`, and with `weights` where a loss was asked for; views rejected as a whole are in its
        correspondences' `skipped`. Where outliers were looked for, `fit.info["robust"]` says how.

    Raises
    ------
    UsageError
        For an unknown method.
    EstimationError, DataError
        Where neither all points nor those that agree by RANSAC give a camera; the error is that of all
        points.
    """
    check_method(method)
    first, failure = None, None
    try:
        data, camera, poses = begin(correspondences, None)
        first = fit(camera, poses, data)
    except (EstimationError, DataError) as error:
        if method == "none":
            raise
        failure = error
    if first is not None and (method == "none" or (method == "auto" and _is_clean(first))):
        return first
    again = None
    if first is None or starts.doubtful(first) or _lost(first) > _START_AGAIN:
        again = restart.from_agreeing(correspondences, begin, fit, agree, seed)
    found = [s for s in (again, first) if s is not None]
    if not found:
        assert failure is not None
        raise failure
    start = min(found, key=lambda s: robust_sigma(np.concatenate(_lengths(s))))
    if method != "auto":
        return reweight(start, fit, LOSSES[method])
    kept = reject(reweight(start, fit, LOSSES["cauchy"], rounds=_ROUNDS // 2), fit)
    improved = restart.second_look(kept, correspondences, fit, _judge(kept).sigma, seed)
    if improved is not None:
        kept = reject(improved, fit)
    return _noted(kept, "all points" if start is first else "the points that agree by RANSAC")


def check_method(method: str) -> None:
    """Raise a UsageError for a method that is none of `METHODS`."""
    if method not in METHODS:
        raise UsageError(
            f"unknown robust method '{method}'.",
            suggestion(method, METHODS) or "Known: " + ", ".join(METHODS),
        )


def _is_clean(solution: Solution) -> bool:
    """Whether nothing speaks against a fit to all points: neither outliers nor a wrong minimum."""
    verdict = _judge(solution)
    gaussian = outliers.looks_gaussian(_standard(solution), verdict.sigma)
    return not verdict.rejected and gaussian and not starts.doubtful(solution)


def _lost(solution: Solution) -> float:
    """The share of points that the test rejects."""
    return _judge(solution).rejected / solution.correspondences.point_count


def _judge(solution: Solution) -> outliers.Verdict:
    return outliers.judge(solution.correspondences, solution.residuals, solution.free_count)


def _standard(solution: Solution) -> Array:
    pairs = zip(solution.correspondences.views, solution.residuals, strict=True)
    return np.concatenate([r if v.sigma is None else r / v.sigma[:, None] for v, r in pairs])


def _lengths(solution: Solution) -> list[Array]:
    pairs = zip(solution.correspondences.views, solution.residuals, strict=True)
    return [outliers.standardised(v, r) for v, r in pairs]


def _noted(solution: Solution, begun_from: str) -> Solution:
    """The solution with how outliers were told, among the information on its fit."""
    verdict = _judge(solution)
    said: dict[str, Any] = {
        "test": f"|r|²/2s² of a point exceeds F(2, nu) at {outliers.ALPHA:g}/N",
        "sigma": verdict.sigma,
        "threshold": verdict.threshold * verdict.sigma,
        "begun_from": begun_from,
        "ransac_confidence": ransac.CONFIDENCE,
    }
    return replace(solution, fit=replace(solution.fit, info={**solution.fit.info, "robust": said}))


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
        # a point outside the lens's domain has no residual and takes no part
        seen = [np.isfinite(length) for length in lengths]
        masks = None if all(m.all() for m in seen) else seen
        solution = fit(
            solution.camera, solution.poses, solution.correspondences, inliers=masks, weights=whole
        )
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
