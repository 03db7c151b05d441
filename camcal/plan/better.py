"""The rule by which one fit is preferred to another.

1. Physical sense: a camera with a finite positive focal length that sees all points it rests on is better than one
   without.
2. On the same points, with the same unknowns, the lower cost is better; a search that converged, where costs are equal
   to rounding.
3. Otherwise (other unknowns: a lens with more coefficients, a board with a shape; or other points: corners fitted
   again) what counts is the error on views held out, with its noise. With d_v the difference of the logarithms of the
   mean squared errors of view v, held out from both,

       t = mean(d_v) / (std(d_v) / sqrt(V))                                                           (1)

   is about Student's t with V - 1 degrees of freedom where neither is better (Nadeau & Bengio, Inference for the
   generalization error, 2003, who also show that folds share views, so that it is only approximate). What asks for
   more unknowns, or for new points, is preferred where chance alone would exceed t with a probability below `CHANCE`.
   Logarithms, as one view of a large error (at the border of the picture, say) else makes most of the mean and of its
   scatter: t is then near 1 even if every view is better. The mean squared error of all views has to be lower as well;
   where the two disagree, d_v are differences of the mean squared errors themselves.
"""

from __future__ import annotations

import numpy as np

from camcal.assess.holdout import HoldOut
from camcal.least_squares.distributions import t_exceeded
from camcal.records import dataclass
from camcal.solve.calibration import Calibration, Estimate

#: of twenty choices between equals one falls on the larger model
CHANCE = 0.05
#: costs nearer than this part of one another are equal to rounding: sums of 1e4 squares of doubles
EQUAL = 1e-12


@dataclass(frozen=True)
class Candidate:
    """A fit, and its hold-out error if that is known."""

    calibration: Estimate
    holdout: HoldOut | None = None


def better(candidate: Candidate, incumbent: Candidate) -> tuple[bool, str]:
    """Return whether a candidate is preferred to the current fit, and the reason."""
    new, old = candidate.calibration, incumbent.calibration
    sensible = physical(new), physical(old)
    if sensible[0] != sensible[1]:
        reason = "the other camera is not physical: its focal length is not positive, or it does not see some points"
        return sensible[0], reason
    if same_points(new, old) and _unknowns(new) == _unknowns(old):
        return _lower_cost(new, old)
    t, views = gain(candidate.holdout, incumbent.holdout)
    if np.isnan(t):
        return False, "there are too few views for a hold-out"
    fewer = same_points(new, old) and new.free_count < old.free_count
    where = "below" if t > 0 else "above"
    said = f"its error on held-out views is {abs(t):.1f} standard errors {where} the other's"
    return t_exceeded(t, views - 1) < (1 - CHANCE if fewer else CHANCE), said


def physical(calibration: Estimate) -> bool:
    """Return whether focal lengths are finite and positive, and all used points project."""
    focal = np.array([np.diag(c.matrix)[:2] for c in calibration.cameras])
    return bool(
        (focal > 0).all() and np.isfinite(focal).all() and np.isfinite(calibration.used_residuals).all()
    )


def gain(candidate: HoldOut | None, incumbent: HoldOut | None) -> tuple[float, int]:
    """Equation (1), positive if the candidate is better, and V; NaN without hold-outs of both."""
    if candidate is None or incumbent is None:
        return float("nan"), 0
    new, old = candidate.mean_squares(), incumbent.mean_squares()
    common = [v for v in new if v in old]
    squares = np.array([(old[v], new[v]) for v in common]).reshape(-1, 2)
    d = squares[:, 0] - squares[:, 1]
    if len(d) < 2 or not np.isfinite(d).all():
        return float("nan"), len(d)
    if (squares > 0).all():
        ratios = np.log(squares[:, 0] / squares[:, 1])
        d = ratios if ratios.mean() * d.mean() > 0 else d
    scatter = float(d.std(ddof=1)) / np.sqrt(len(d))
    if scatter > 0:
        return float(d.mean() / scatter), len(d)
    return (float(np.sign(d.mean()) * np.inf) if d.any() else 0.0), len(d)


def same_points(a: Estimate, b: Estimate) -> bool:
    """Return whether two fits use the same image points with the same weights."""
    x, y = a.observations, b.observations
    if x.view_ids != y.view_ids or not np.array_equal(x.used, y.used) or not np.array_equal(x.uv, y.uv):
        return False
    p, q = (np.ones(1) if o.precision is None else o.precision for o in (x, y))
    return bool(np.array_equal(np.broadcast_to(p, x.used.shape), np.broadcast_to(q, x.used.shape)))


def _unknowns(calibration: Estimate) -> tuple[str, int]:
    board = calibration.board
    lenses = " ".join(c.lens.name for c in calibration.cameras)
    return (f"{lenses} {board.kind if board else 'flat'}", calibration.free_count)


def _lower_cost(new: Estimate, old: Estimate) -> tuple[bool, str]:
    ours, theirs = new.fit.cost, old.fit.cost
    if ours < theirs * (1 - EQUAL):
        return True, f"a lower cost on the same points: {ours:.9g} instead of {theirs:.9g}"
    if ours <= theirs * (1 + EQUAL) and new.fit.converged and not old.fit.converged:
        return True, "the same cost on the same points, and converged"
    return False, f"no lower cost on the same points: {ours:.9g} instead of {theirs:.9g}"


def lowest(calibrations: list[Calibration]) -> Calibration:
    """The best of several fits to the same points with the same unknowns."""
    best = calibrations[0]
    for other in calibrations[1:]:
        if better(Candidate(other), Candidate(best))[0]:
            best = other
    return best
