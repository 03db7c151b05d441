"""Selection of the lens model: each is fitted from its best start and compared on hold-out views.

The points are the same for all (those that the best model believes), the poses of held-out views are refitted,
and a model that contains another also begins from that one's optimum: it never scores worse for a bad start.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import Any

import numpy as np

from camcal.assess import figures
from camcal.assess.checks import check
from camcal.assess.holdout import HoldOut, hold_out
from camcal.data.observations import Observations
from camcal.errors import CamcalError, DataError, EstimationError
from camcal.model import lenses
from camcal.model.lenses.base import Lens
from camcal.model.lenses.containment import embed
from camcal.plan.better import lowest
from camcal.plan.options import OnEvent, Options
from camcal.plan.run import solved
from camcal.records import dataclass
from camcal.solve import starts
from camcal.solve.calibration import Calibration
from camcal.solve.refine import How, refine

#: what `--model select` chooses from: each kind of lens once, none with more parameters than a dozen views determine
AUTO = (
    "pinhole", "brown:radial=1,decentering=0", "brown:radial=2,decentering=0", "opencv4", "opencv5", "opencv8",
    "kb4", "ucm", "eucm", "ds", "mei", "fov", "division:1", "division:2",
)  # fmt: skip
#: names that stand for another model of the table
_SYNONYMS = ("kb", "tilted", "polynomial")
#: warnings that put a model out of the choice
OUT = ("fold-in-image", "points-outside-model", "undetermined-parameters", "weak-parameters", "not-converged")
#: a model with fewer parameters is preferred when its hold-out error is at most this much larger, as a part:
#: over a thousand points chance alone makes about as much
WORTH = 0.01
#: a cost up to so many times another is as low but for rounding
AS_LOW = 1 + 1e-9


@dataclass(frozen=True)
class Candidate:
    """A model and its results.

    Attributes
    ----------
    model : str
    solution : Solution or None
        None where it could not be fitted.
    holdout : HoldOut or None
        None where it was not fitted, or there are too few views.
    reasons : tuple of str
        Why it is out of the choice; empty for one that is in.
    seconds : float
    """

    model: str
    solution: Calibration | None
    holdout: HoldOut | None
    reasons: tuple[str, ...]
    seconds: float

    @property
    def parameters(self) -> int:
        """Number of free parameters of the camera."""
        return 0 if self.solution is None else self.solution.free.shape[1]

    @property
    def holdout_rms(self) -> float:
        """rms_point of the hold-out, px; inf without one."""
        return figures.ranked(None if self.holdout is None else self.holdout.figures.rms_point)

    def information(self) -> tuple[float, float]:
        """Akaike's and Schwarz's criteria (AIC, BIC) for Gaussian noise of unknown variance, corrected for few
        coordinates.

        n log(SSE / n) + 2 p n / (n - p - 1) and n log(SSE / n) + (p - 1) log(n) n / (n - p - 1) over the n = 2N
        coordinates, p all parameters and the variance (Hurvich & Tsai, Regression and time series model selection
        in small samples, Biometrika 76, 1989; McQuarrie, A small-sample correction for the Schwarz SIC model
        selection criterion, Statistics & Probability Letters 44, 1999). Infinite where n - p - 1 is not positive:
        without the correction a lens of 15 unknowns is the best for the 16 coordinates of 8 points.
        """
        if self.solution is None:
            return np.inf, np.inf
        r = self.solution.used_residuals
        n, p = r.size, self.solution.free_count + 1
        if n <= p + 1:
            return np.inf, np.inf
        with np.errstate(divide="ignore"):  # exact data
            fit = n * np.log(float((r**2).sum()) / n)
        few = n / (n - p - 1)
        return figures.ranked(fit + 2 * p * few), figures.ranked(fit + (p - 1) * np.log(n) * few)


@dataclass(frozen=True)
class Selection:
    """The candidates, best first, and the chosen one."""

    candidates: tuple[Candidate, ...]
    chosen: Candidate
    correspondences: Observations
    why: str


def all_models() -> tuple[str, ...]:
    """Every model of the table with its default options."""
    return tuple(n for n in lenses.LENSES if n not in _SYNONYMS)


def select(
    correspondences: Observations,
    models: Sequence[str] = AUTO,
    skew: bool = False,
    fix: Mapping[str, float | None] | None = None,
    robust: str = "auto",
    folds: int = 5,
    seed: int = 0,
    on_event: OnEvent | None = None,
) -> Selection:
    """Fit every model and rank them by their hold-out error.

    Parameters
    ----------
    models : sequence of str
        Specs.
    fix : mapping
        As in `refine`; what a model does not have is left out for it.
    on_event : callable, optional
        Called with `("model", {model, done, count})`.

    Raises
    ------
    EstimationError
        If no model can be fitted.
    """
    tell = on_event or (lambda name, details: None)
    made = {lens.name: lens for lens in (lenses.make(m, skew) for m in models)}
    ordered = sorted(made.values(), key=lambda lens: lens.size)
    bench = _Bench(fix or {}, robust, seed)
    data, first = bench.common_points(correspondences, ordered, tell)
    done: list[Candidate] = []
    for lens in ordered:
        done.append(bench.candidate(lens, data, first[lens.name], done, folds))
        tell("model", {"model": lens.name, "done": len(ordered) + len(done), "count": 2 * len(ordered)})
    ranked = sorted(done, key=lambda c: (c.solution is None, c.holdout_rms, *c.information()[1:]))
    if ranked[0].solution is None:
        raise EstimationError(f"none of the models can be fitted: {ranked[0].reasons[0]}")
    chosen, why = _choose(ranked)
    return Selection(tuple(ranked), chosen, data, why)


def _choose(ranked: Sequence[Candidate]) -> tuple[Candidate, str]:
    """The smallest eligible model that is as good as the best."""
    usable = [c for c in ranked if c.solution is not None and not c.reasons]
    remark = ""
    if not usable:
        usable, remark = (
            [c for c in ranked if c.solution is not None],
            "; every model has a problem",
        )
    if not np.isfinite(usable[0].holdout_rms):
        best = min(usable, key=lambda c: c.information()[1])
        return best, f"the lowest BIC: too few views for a hold-out{remark}"
    bound = usable[0].holdout_rms * (1 + WORTH)
    best = min((c for c in usable if c.holdout_rms <= bound), key=lambda c: (c.parameters, c.holdout_rms))
    if best is usable[0]:
        return best, f"the lowest hold-out error{remark}"
    return (
        best,
        f"fewer parameters than {usable[0].model}, whose hold-out error is less than {WORTH:.0%} lower{remark}",
    )


@dataclass
class _Bench:
    """The inputs shared by all models."""

    fix: Mapping[str, float | None]
    robust: str
    seed: int
    failed: dict[str, str] = field(default_factory=dict)

    def fixed(self, lens: Lens) -> dict[str, float | None]:
        """The parameters that a model holds: its own gauge, and those of `fix` that it has."""
        asked = {n: v for n, v in self.fix.items() if starts.has(lens, n)}
        return {**dict.fromkeys(lens.default_fixed), **asked}

    def calibrated(self, lens: Lens, data: Observations, robust: str) -> Calibration | None:
        """The calibration by the plan; None, with the reason recorded, if it fails."""
        asked = {n: v for n, v in self.fix.items() if starts.has(lens, n)}
        try:
            options = Options(
                lens.name, skew=lens.has_skew, fix=asked, robust=robust, seed=self.seed, lowest=False
            )
            return solved(data, options).fit
        except DataError:
            raise
        except CamcalError as error:
            self.failed[lens.name] = error.message
            return None

    def common_points(
        self, data: Observations, ordered: Sequence[Lens], tell: OnEvent
    ) -> tuple[Observations, dict[str, Calibration | None]]:
        """The points kept by the model with the lowest median error, and each model's first solution."""
        found: dict[str, Calibration | None] = {}
        for i, lens in enumerate(ordered):
            found[lens.name] = self.calibrated(lens, data, self.robust)
            tell("model", {"model": lens.name, "done": i + 1, "count": 2 * len(ordered)})
        solved = [s for s in found.values() if s is not None]
        if not solved:
            raise EstimationError(f"none of the models can be fitted: {next(iter(self.failed.values()))}")
        kept = min(solved, key=_typical_error).observations.kept()
        again = {n: s if s is not None and _same_points(s, kept) else None for n, s in found.items()}
        return kept, again

    def candidate(
        self, lens: Lens, data: Observations, first: Calibration | None, done: Sequence[Candidate], folds: int
    ) -> Candidate:
        """Fit a model to the common points from every available start, and run the hold-out."""
        begin = time.perf_counter()
        solution = first if first is not None else self.calibrated(lens, data, "none")
        fix = self.fixed(lens)
        tried: list[Calibration] = [] if solution is None else [solution]
        for inner in (c.solution for c in done if c.solution is not None):
            known = embed(lens, inner.camera.lens, inner.camera.params)
            if known is not None and (not tried or inner.fit.cost < tried[0].fit.cost * AS_LOW):
                tried.append(refine(*starts.adopted(lens, inner, fix), data, How(fix)))
        if not tried:
            reason = self.failed.get(lens.name, "it could not be fitted")
            return Candidate(lens.name, None, None, (reason,), time.perf_counter() - begin)
        best = lowest(tried)
        warned = tuple(w.message for w in check(best) if w.code in OUT)
        held = hold_out(best, How(fix), folds)
        return Candidate(lens.name, best, held, warned, time.perf_counter() - begin)


def _typical_error(solution: Calibration) -> float:
    """The median length of all residuals, px; those of points that a model does not project are infinite."""
    lengths = np.linalg.norm(solution.residuals, axis=1)
    return float(np.median(np.where(np.isfinite(lengths), lengths, np.inf)))


def _same_points(solution: Calibration, kept: Observations) -> bool:
    """Return whether a solution uses exactly these points."""
    data = solution.observations
    return (
        data.view_ids == kept.view_ids and bool(solution.used.all()) and data.point_count == kept.point_count
    )


def described(selection: Selection) -> dict[str, Any]:
    """The selection as plain values, for reports."""
    lowest = [min(c.information()[i] for c in selection.candidates) for i in (0, 1)]
    return {
        "chosen": selection.chosen.model,
        "why": selection.why,
        "points": selection.correspondences.point_count,
        "views": len(selection.correspondences.views),
        "models": [_entry(c, lowest) for c in selection.candidates],
    }


def _entry(candidate: Candidate, lowest: Sequence[float]) -> dict[str, Any]:
    entry: dict[str, Any] = {"model": candidate.model, "parameters": candidate.parameters}
    if candidate.solution is not None:
        solution, (aic, bic) = candidate.solution, candidate.information()
        held = candidate.holdout.figures if candidate.holdout is not None else None
        entry |= {
            "rms_point": solution.rms_point,
            "sigma_hat": figures.sigma_hat(solution),
            "holdout": None if held is None else {"rms_point": held.rms_point, "p95": held.p95},
            "aic_difference": aic - lowest[0],
            "bic_difference": bic - lowest[1],
            "converged": solution.fit.converged,
        }
    return entry | {"out": list(candidate.reasons), "seconds": candidate.seconds}
