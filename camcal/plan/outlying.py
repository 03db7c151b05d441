"""Attempts that handle outliers, given sigmas, and views that do not belong.

`auto` first fits as if all were well. Only where the residuals speak against that, or where there is no such fit, is
the camera re-estimated from the points on which RANSAC agrees, reweighted by a redescending loss, and fitted to what a
stated test keeps. Clean data thus get the least squares answer itself, and pay for one test.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from camcal.assess import causes
from camcal.assess import outliers as foreign
from camcal.errors import EstimationError
from camcal.plan.better import Candidate
from camcal.plan.minima import LOWEST, from_nothing
from camcal.plan.progress import Attempt, Change, Progress
from camcal.solve import noise, outliers, ransac, robust, starts
from camcal.solve.calibration import Calibration
from camcal.solve.losses import LOSSES
from camcal.solve.refine import refine

#: from this share of rejected points on, the least squares fit is no place to start from: at 2 % gross outliers its
#: focal length is off by several of its sigmas
START_AGAIN = 0.02
#: views from which a start is tried where all of them give none, at least
LEAST_VIEWS = 3
#: the loss of the fit by which `auto` judges points, and its reweightings: the test needs few digits
LOSS, LOSS_ROUNDS = "cauchy", 10
#: given sigmas and the fit that they weight are brought to agree in so many rounds at most, to so much of a sigma: a
#: weight that is off by 2 % costs nothing of the estimate's accuracy
WEIGHTINGS, SAME_SIGMA = 5, 0.01


def _clean(progress: Progress) -> bool:
    """Return whether the fit to all points shows neither outliers nor a wrong minimum."""
    return (
        progress.plain is not None
        and not starts.doubtful(progress.plain)
        and outliers.is_clean(progress.plain)
    )


def _wants_robust(progress: Progress) -> bool:
    method = progress.options.robust
    return method != "none" and not (method == "auto" and _clean(progress))


def wants_restart(progress: Progress) -> bool:
    """Return whether the camera is to be re-estimated from the points that agree."""
    if progress.restarts or not _wants_robust(progress):
        return False
    plain = progress.plain
    if plain is None or starts.doubtful(plain):
        return True
    return outliers.test(plain).rejected / plain.observations.point_count > START_AGAIN


def _agreeing(progress: Progress) -> Change:
    """The points of each view that agree on a map of its own."""
    data = progress.data
    found = ransac.of_maps(data.views, data.shapes.planar.tolist(), progress.options.seed)
    used = np.concatenate([a.mask for a in found])
    return Change(data=data.with_used(used), again=True, notes={"agreed": found})


def _half_agreeing(progress: Progress) -> Change:
    """The half of the views with the best agreement."""
    found = progress.notes["agreed"]
    scatter = np.array([a.sigma for a in found])  # NaN, where there are too few points, comes last
    count = max(len(found) // 2, LEAST_VIEWS)
    rows = np.sort(np.argsort(scatter, kind="stable")[:count])
    return Change(data=progress.data.of_views(rows), again=True)


def _no_camera_from_all(progress: Progress) -> bool:
    return progress.restarts == 1 and progress.best is None


def _found_from_half(progress: Progress) -> bool:
    return progress.restarts == 2 and progress.best is not None


def _all_poses(progress: Progress) -> Change:
    """The poses of all views with respect to the camera of half of them."""
    data = progress.given.unweighted()
    found = robust.find_poses(progress.fit, data, progress.how, progress.options.seed)
    return Change(fit=Candidate(found), instead=True)


def _reweight(progress: Progress) -> Change:
    """Reweighting, starting from the better of the fits to all points and to those that agree."""
    found = [] if progress.best is None else [progress.fit]
    found += [progress.plain] if progress.plain is not None else []
    if not found:
        raise EstimationError(
            "no camera can be estimated, neither from all points nor from the consistent ones."
        )
    start = min(found, key=robust.spread)
    method = progress.options.robust
    auto = method == "auto"
    made = robust.reweight(
        start, progress.how, LOSSES[LOSS if auto else method], **({"rounds": LOSS_ROUNDS} if auto else {})
    )
    origin = "all points" if start is progress.plain else "the points on which RANSAC agrees"
    return Change(fit=Candidate(made), instead=True, notes={"begun_from": origin})


def _wants_reweighting(progress: Progress) -> bool:
    return _wants_robust(progress) and (progress.best is not None or progress.plain is not None)


def _rejects(progress: Progress) -> bool:
    return progress.best is not None and progress.options.robust == "auto"


def _after_reweighting(progress: Progress) -> bool:
    return _rejects(progress) and "begun_from" in progress.notes


def _reject(progress: Progress) -> Change | None:
    kept = robust.reject(progress.fit, progress.how)
    return None if kept is progress.fit else Change(fit=Candidate(kept), instead=True)


def _better_poses(progress: Progress) -> Change | None:
    data = progress.given.unweighted()
    found = robust.find_better_poses(progress.fit, data, progress.how, progress.options.seed)
    if found is None:
        return None
    return Change(fit=Candidate(robust.reject(found, progress.how)), instead=True)


def _plain_is_lower(progress: Progress) -> bool:
    """Return whether the least-squares fit to all points fits the kept points better than the fit to them does."""
    plain = progress.plain
    if not _after_reweighting(progress) or plain is None:
        return False
    rows = _rows_of(plain, progress.fit)
    squares = np.square(plain.residuals[rows]).sum(1)[progress.fit.used]
    return bool(0.5 * squares.sum() < progress.fit.fit.cost)  # the cost is half the sum of squares


def _rows_of(plain: Calibration, kept: Calibration) -> np.ndarray:
    """The rows (N,) of all observations that the views of a fit hold."""
    held = np.isin(plain.observations.view_ids, kept.observations.view_ids)
    return held[plain.observations.view]


def _from_plain(progress: Progress) -> Change:
    """The fit to the kept points from the camera of all points, so that rejection never makes a fit worse."""
    plain = progress.plain
    assert plain is not None
    places = [plain.observations.view_ids.index(v) for v in progress.fit.observations.view_ids]
    found = refine(plain.camera, plain.poses[np.array(places)], progress.data, progress.how)
    return Change(fit=Candidate(found))


# ------------------------------------------------------------------------------------------------- given sigmas
def _has_sigmas(progress: Progress) -> bool:
    sigma = progress.given.sigma
    return progress.best is not None and sigma is not None and not np.isnan(sigma).any()


def _weight(progress: Progress) -> Change:
    """The fit with the given sigmas, as far as the residuals support them."""
    fit, given = progress.fit, progress.given
    places = [given.view_ids.index(v) for v in fit.observations.view_ids]
    sigma = given.of_views(places).sigma
    assert sigma is not None
    model, made = noise.NoiseModel(1.0, 0.0), fit
    for _ in range(WEIGHTINGS):
        data = replace(fit.observations, sigma=model.sigmas(sigma), weight=None)
        made, before = refine(made.camera, made.poses, data, progress.how), model
        model = noise.noise_model(made, sigma)
        ratio = model.sigmas(sigma) / before.sigmas(sigma)
        if np.ptp(ratio) <= SAME_SIGMA * ratio.mean():  # a common factor changes nothing
            break
    if progress.options.robust not in ("auto", "none"):
        made = robust.reweight(made, progress.how, LOSSES[progress.options.robust])
    described = {"scale": model.scale, "floor_px": model.floor}
    return Change(fit=Candidate(made), instead=True, notes={"noise_model": described})


# ------------------------------------------------------------------------------------------------ foreign views
def _without_foreign(progress: Progress) -> Change | None:
    """Remove views that fit a pose well enough to be used but bias the camera."""
    fit = progress.fit
    bad = foreign.foreign_views(fit)
    if not bad:
        return None
    found = causes.find(fit, progress.given)
    if found.common:
        return Change(notes={"causes": (fit, found)})  # for the checks of the result
    data = fit.observations.without(dict.fromkeys(bad, "does not fit the other views"))
    rest = [i for i in range(len(fit.poses)) if i not in bad]
    made = refine(fit.camera, fit.poses[np.array(rest)], data, progress.how)
    return Change(fit=Candidate(robust.reject(made, progress.how)), instead=True)


REJECT = Attempt("rejected", _rejects, _reject)

#: what follows once points that agree were looked for
AFTER_RESTART: tuple[Attempt, ...] = (
    Attempt("reweighted", _wants_reweighting, _reweight),
    Attempt("rejected", _after_reweighting, _reject),
    Attempt("better-poses", _after_reweighting, _better_poses),
    Attempt("from-all-points", _plain_is_lower, _from_plain),
)


def outliers_plan() -> tuple[Attempt, ...]:
    """The attempts after a first fit to all points: outliers and other minima."""
    return (
        Attempt("agreeing", wants_restart, _agreeing),
        *from_nothing(),
        Attempt("agreeing-half", _no_camera_from_all, _half_agreeing),
        *from_nothing(),
        Attempt("all-poses", _found_from_half, _all_poses),
        *AFTER_RESTART,
        *LOWEST,
    )


SIGMAS = Attempt("weighted", _has_sigmas, _weight)
FOREIGN = Attempt("without-foreign-views", _rejects, _without_foreign)
