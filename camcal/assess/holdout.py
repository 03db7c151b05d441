"""Hold-out: cameras estimated from some of the views and tested on the others, with only their poses refitted.

The residuals of views that took no part show what those of the fit hide: parameters that follow the noise, a
model that does not hold (Arlot & Celisse, A survey of cross-validation procedures, 2010).

The fit to all views is a stationary point, so that without the views of a fold one Gauss-Newton step from it, with the
blocks S_v and g_v of `design.py`,

    δ = -(Σ_train S_v)⁻¹ Σ_train g_v                                                                    (1)

is the fit to the rest up to second order in δ. It is taken where the cost falls by what the step predicts; elsewhere,
and for boards with a shape, the rest is refitted. The same step moves the poses of the views held out, whose costs
have their minimum there: what it leaves out is of fourth order in their residuals.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from camcal.assess import figures
from camcal.assess.design import Design
from camcal.data.observations import Observations
from camcal.errors import CamcalError, UsageError
from camcal.geometry.numbers import TINY
from camcal.model.pose import Array, Poses
from camcal.records import dataclass
from camcal.solve.board_points import shaped
from camcal.solve.calibration import Calibration, Estimate, NormalBlocks
from camcal.solve.poses import poses_before
from camcal.solve.refine import How, as_designed, refit, residuals, subject_of

#: problems up to this size are held out unasked: a fraction of a second
CHEAP_POINTS, CHEAP_PARAMETERS = 10_000, 40
FOLDS = 4  #: each camera then has three quarters of the views, for the cost of four fits
#: views that a hold-out needs at least
LEAST_VIEWS = 4
#: the step (1) is accepted where the decrease of the cost differs from the predicted one by less than this part of it
#: (the rest is of third order), or of one σ0²: a hundredth of what noise alone moves a parameter by
TRUSTED = 0.1


@dataclass(frozen=True)
class HoldOut:
    """The results of the folds.

    Attributes
    ----------
    view_ids : tuple of str
        The views, each held out once.
    folds : int
    residuals : tuple of (N, 2) arrays
        Of the used points of each view, px, by the camera that did not see it.
    fits : tuple of Calibration
        One a fold, of the views that were not held out.
    trained : tuple of (T,) int arrays
        Which views those were.
    """

    view_ids: tuple[str, ...]
    folds: int
    residuals: tuple[Array, ...]
    fits: tuple[Estimate, ...] = ()
    trained: tuple[Array, ...] = ()

    @property
    def figures(self) -> figures.Figures:
        """The error figures of all held-out residuals."""
        return figures.of(np.concatenate(self.residuals))

    def mean_squares(self) -> dict[str, float]:
        """The mean squared length of each view's residuals, px², by its id."""
        means = (float(np.square(r).sum(1).mean()) for r in self.residuals)
        return dict(zip(self.view_ids, means, strict=True))


def hold_out(
    calibration: Estimate, how: How, folds: int = FOLDS, design: Design | None = None
) -> HoldOut | None:
    """Hold out every view once, in `folds` rounds of every so-many-th view.

    Parameters
    ----------
    calibration : Calibration
        Its used points are those that every fold uses, too.
    how : How
        How it was made.
    design : Design, optional
        Of the calibration, where others use it, too.

    Returns
    -------
    HoldOut, or None where there are fewer than 4 views, or a fold cannot be estimated from the rest.
    """
    count = len(calibration.poses)
    if count < LEAST_VIEWS:
        return None
    folds = min(folds, count)
    found: list[Array] = [np.zeros((0, 2))] * count
    fits, trained = [], []
    data = as_designed(calibration)
    if isinstance(calibration, Calibration) and calibration.board is None:
        design = design or Design(calibration)
    else:
        design = None
    for fold in range(folds):
        test = np.arange(fold, count, folds)
        train = np.flatnonzero(np.arange(count) % folds != fold)
        step = None if design is None else _one_step(design, train)
        held = data.of_views(test).kept()
        if design is not None and step is not None:
            fit: Estimate = step.fit
            unseen = residuals(subject_of(fit), step.poses(test), held)
            if not np.isfinite(unseen).all():  # a pose at which a point cannot be seen
                unseen = residuals_of(fit, held, calibration.poses[test])
        else:
            try:
                start = calibration.poses[train]
                fit = refit(calibration, data.of_views(train), how, start)
            except CamcalError:
                return None  # too few views are left
            unseen = residuals_of(fit, held, calibration.poses[test])
        for place, i in enumerate(test):
            found[int(i)] = unseen[held.view == place]
        fits.append(fit)
        trained.append(train)
    return HoldOut(data.view_ids, folds, tuple(found), tuple(fits), tuple(trained))


def residuals_of(fit: Estimate, held: Observations, poses: Poses) -> Array:
    """Residuals (N, 2) of views not used in a fit, with their poses refitted, px."""
    if fit.board is not None:
        held = shaped(held, fit.board)
    return residuals(subject_of(fit), poses_before(fit, held, poses), held)


@dataclass(frozen=True)
class _Step:
    """The result of (1): the fit to some views, and the poses of the others with respect to its camera."""

    design: Design
    step: Array
    fit: Calibration

    def poses(self, views: Array) -> Poses:
        """Poses of views (T,), cam_from_board."""
        return _moved(self.design, views, self.step)


def _moved(design: Design, views: Array, step: Array) -> Poses:
    """The poses of views (T,) that are optimal for the camera after a step (F,)."""
    f = design.transform.shape[1]
    pull = design.products[views, f : f + 6, -1]
    turn = -np.einsum("vij,vj->vi", design.poses.inverse[views], pull) - design.poses.gain[views] @ step
    return design.moved_poses(views, turn)


def _one_step(design: Design, train: Array) -> _Step | None:
    """The fit to the views `train` (T,) by (1); None if the cost does not follow the prediction."""
    whole, f = design.calibration, design.transform.shape[1]
    information, pull = design.information[train].sum(0), design.pull[train].sum(0)
    if not f:
        return None
    scale = 1 / np.sqrt(np.maximum(np.diag(information), TINY))
    try:
        step = -scale * np.linalg.solve(information * scale * scale[:, None], scale * pull)
    except np.linalg.LinAlgError:
        return None  # the rest does not determine the camera
    products, poses = design.products[train], _moved(design, train, step)
    camera = replace(whole.camera, params=whole.camera.params + design.transform @ step)
    data = whole.observations.of_views(train)
    off = residuals(camera, poses, data)
    weight = 1.0 if data.precision is None else data.precision[data.used]
    cost = 0.5 * float((weight * np.square(off[data.used]).sum(1)).sum())
    before = 0.5 * float(products[:, -1, -1].sum())
    predicted = -0.5 * float(pull @ step) + 0.5 * float(
        np.einsum(
            "vi,vij,vj->", products[:, f : f + 6, -1], design.poses.inverse[train], products[:, f : f + 6, -1]
        )
    )
    unit = design.sigma_0**2 if np.isfinite(design.sigma_0) else 0.0
    if not abs(before - cost - predicted) <= TRUSTED * max(predicted, unit):
        return None
    blocks = design.normal
    normal = NormalBlocks(products[:, :f, :f].sum(0), blocks.coupling[train], blocks.poses[train])
    fit = replace(whole.fit, cost=cost)
    made = Calibration(
        camera=camera,
        poses=poses,
        observations=data,
        residuals=off,
        start=whole.camera,
        free=design.transform,
        normal=normal,
        fit=fit,
    )
    return _Step(design, step, made)


# ------------------------------------------------------------------------------------------------- for the report
def folds_wanted(calibration: Estimate, folds: int | None) -> int:
    """The number of folds: as requested, or 4 where that is cheap, otherwise 0.

    Raises
    ------
    UsageError
        If more folds are requested than there are views.
    """
    views = len(calibration.poses)
    if folds is not None and folds > 0 and (views < LEAST_VIEWS or folds > views or folds < 2):
        raise UsageError(
            f"{folds} folds of {views} views cannot be held out.",
            f"Hold-out needs {LEAST_VIEWS} views or more, and 2 folds up to the number of views.",
        )
    if folds is None:
        cheap = calibration.observations.point_count <= CHEAP_POINTS
        largest = max(c.lens.size for c in calibration.cameras)
        folds = FOLDS if cheap and largest <= CHEAP_PARAMETERS else 0
    return folds if views >= LEAST_VIEWS and calibration.free.any() else 0


def described(held: HoldOut, difference: Mapping[str, Any] | None) -> dict[str, Any]:
    """The report's entry of a hold-out; `difference` is that of the folds' cameras."""
    found = held.figures
    return {
        "views": len(held.view_ids),
        "folds": held.folds,
        "points": found.points,
        "rms_point": found.rms_point,
        "p95": found.p95,
        "difference": difference,
    }
