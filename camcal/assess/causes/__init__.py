"""Common causes of disagreement between views, tested before single views are rejected.

Zooming, resized pictures, a rolling shutter or a badly printed board make views disagree, and the views that disagree
most would then be mistaken for mirror images or other boards. `find` first tests whether one small model explains all
views (`search.py`), and `words.py` describes it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from camcal.assess.causes.effect import effect_px
from camcal.assess.causes.search import EVIDENCE, Search, Trial
from camcal.assess.warning import BY_CHANCE
from camcal.data.observations import Observations
from camcal.errors import CamcalError
from camcal.geometry.projective import FLAT_RAY
from camcal.model.pose import Array, Poses
from camcal.records import dataclass
from camcal.solve.board_points import shaped
from camcal.solve.calibration import Calibration
from camcal.solve.losses import robust_sigma
from camcal.solve.optimizers.base import Options
from camcal.solve.refine import How, refine
from camcal.start.pose import initial_poses

#: larger problems are not searched: it takes 30 to 60 passes over the data, as much as a calibration
MOST_POINTS, MOST_VIEWS = 20_000, 150
#: Two parts of the views are the cause if they explain this fraction of what parameters of each view explain (all of
#: it in the ideal case). The best two parts explain 2/pi = .64 of the variance of Gaussian numbers and 3/4 of
#: that of uniform ones or of an even drift, which form no parts at all; bent boards and blur leave half of it on a real
#: set of 17 pictures. Above 3/4, a fifth is left to other errors.
MOST_OF_IT = 0.8
#: Largest residual scale with a cause, relative to that of the points kept by the solution, at which the cause also
#: explains the rejected views: a view with shifted rows of the board leaves thirty times the noise with any camera.
MOST_LEFT = 3.0
#: least number of views for one parameter per view to be informative about all of them
LEAST_FOR_EACH = 6
#: least number of views: of two, neither can be identified as the different one (the mirrored, turned or foreign one)
LEAST_VIEWS = 3


@dataclass(frozen=True)
class Found:
    """The cause that explains the views.

    Attributes
    ----------
    base : Calibration
        The fit to all views, rejected ones included.
    trial : Trial or None
        The best candidate; None if the unchanged solution is better.
    views : bool
        Whether single views explain it, so that the set as a whole is sound.
    effect, scatter : float
        Resulting error of the camera, px: for the mean view, and rms over the views.
    sigma : float
        Residual scale with the cause, in the unit of the weights (px without sigmas).
    before : float
        The same without the cause.
    share : float
        Share of the squares explained by parameters of each view, beyond noise, that the candidate explains.
    """

    base: Calibration
    trial: Trial | None
    views: bool
    effect: float
    scatter: float
    sigma: float
    before: float
    share: float = 1.0

    @property
    def common(self) -> bool:
        """Return whether a cause that all views share explains them better than a few outlying views do."""
        trial = self.trial
        parts = trial is not None and trial.how in ("split", "groups", "sides")
        return trial is not None and not self.views and (not parts or self.share > MOST_OF_IT)

    @property
    def cause(self) -> Trial | None:
        """The candidate if it concerns all views and not the target, which has its own checks."""
        trial = self.trial
        if trial is None or self.views or trial.kind in ("board", "circles"):
            return None
        if trial.how == "each":
            return trial if len(self.base.poses) >= LEAST_FOR_EACH else None
        return trial if self.share > MOST_OF_IT else None


def find(solution: Calibration, given: Observations | None = None) -> Found:
    """Find the cause that explains the views of a solution.

    Parameters
    ----------
    solution : Calibration
    given : Observations, optional
        All views; those that the solution rejected take part, with all their points.
    """
    base = _with_rejected(solution, given) if given is not None else solution
    nothing = Found(base, None, False, 0.0, 0.0, float("nan"), float("nan"))
    points, views = base.observations.point_count, len(base.poses)
    if points > MOST_POINTS or views > MOST_VIEWS or views < LEAST_VIEWS or not base.free.any():
        return nothing
    try:
        search = Search(base)
        trials = search.all()
    except np.linalg.LinAlgError:
        return nothing
    if not trials or not trials[0].bic < search.none - EVIDENCE:
        return nothing
    best = trials[0]
    if search.by_chance(best) > BY_CHANCE:
        return nothing
    assert search.linear is not None
    left = float(np.sqrt(2 * best.cost / (search.freedom - best.numbers)))
    before = float(np.sqrt(2 * search.linear.cost / search.freedom))
    share = _share(best, trials, search.linear.cost, search.freedom)
    unexplained = left > MOST_LEFT * _noise(solution)
    return Found(base, best, best.kind == "views" or unexplained, *effect_px(base, best), left, before, share)


def _noise(solution: Calibration) -> float:
    """The robust scale of the points used by a solution, in the unit of its weights."""
    lengths = solution.observations.standardised(solution.residuals)[solution.used]
    return robust_sigma(lengths, solution.free_count)


def _share(best: Trial, trials: Sequence[Trial], cost: float, freedom: int) -> float:
    """The squares that a candidate explains relative to separate parameters per view, minus the effect of noise."""
    rivals = [t for t in trials if t.how == "each"]
    if not rivals:
        return 1.0
    each = min(rivals, key=lambda t: t.cost)
    noise = min(t.cost / (freedom - t.numbers) for t in (best, each))
    most = cost - each.cost - noise * each.numbers
    return (cost - best.cost - noise * best.numbers) / most if most > 0 else 1.0


def _sigmas(data: Observations, rows: Observations) -> Array | None:
    """The sigmas of the solution, for its views and others; the latter get the median."""
    if data.sigma is None:
        return None
    known = dict(zip(data.view_ids, data.slices, strict=True))
    usual = float(np.median(data.sigma))
    own = [data.sigma[known[v.id]] if v.id in known else np.full(len(v), usual) for v in rows.views]
    return np.concatenate(own)


def _with_rejected(solution: Calibration, given: Observations) -> Calibration:
    """The fit to the used points and all points of rejected views; the solution if none of these has a pose."""
    data = solution.observations
    rejected = {s.id for s in data.skipped if s.status == "rejected"}
    if solution.board is not None:
        given = shaped(given, solution.board)
    known = {name: i for i, name in enumerate(data.view_ids)}
    index, poses, used = [], [], []
    for i, view in enumerate(given.views):
        if view.id in known:
            at = known[view.id]
            pose = solution.poses[at]
            used.append(data.used[data.slices[at]])
        elif view.id in rejected and len(view):
            rays = solution.camera.unproject(view.uv)
            with np.errstate(invalid="ignore"):
                if not (rays[:, 2] > FLAT_RAY).all():
                    continue
            try:
                pose = initial_poses([view.xyz], [rays[:, :2] / rays[:, 2:]])[0]
            except CamcalError:
                continue
            used.append(np.ones(len(view), bool))
        else:
            continue
        index.append(i)
        poses.append(pose)
    if len(index) == len(known):
        return solution
    rows = given.of_views(index)
    rows = replace(rows, sigma=_sigmas(data, rows), weight=None)
    how = How(solution.held, stopping=Options(max_iterations=30))
    try:
        return refine(solution.camera, Poses.stack(poses), rows.with_used(np.concatenate(used)), how)
    except CamcalError:
        return solution
