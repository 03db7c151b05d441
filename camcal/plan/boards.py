"""Attempts at the shape of the board: bowl, print, free."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from camcal.assess import board_shape
from camcal.assess.board_shape import CANDIDATES, SIGNIFICANT, Trial
from camcal.assess.holdout import hold_out
from camcal.assess.shape_benefit import Change as Benefit
from camcal.assess.shape_benefit import change as benefit
from camcal.data.observations import Observations
from camcal.errors import CamcalError, UsageError
from camcal.plan.better import Candidate
from camcal.plan.progress import Attempt, Change, Progress
from camcal.solve import robust
from camcal.solve.calibration import Estimate
from camcal.solve.refine import How, refit


def _flat(progress: Progress) -> Estimate:
    """The fit with the board as designed, that shapes are compared with."""
    found = progress.notes.get("flat")
    return found if isinstance(found, Estimate) else progress.estimate


def shape_attempt(kind: str) -> Attempt:
    """The attempt with a kind of shape: taken as it is where it was asked for, else where it is better."""

    def applies(progress: Progress) -> bool:
        several = len((progress.given.target or {}).get("boards", ())) > 1
        if several and progress.options.board_shape == kind:
            raise UsageError(
                "several boards were found; the shape of one board alone can be estimated.",
                "Name the board with --target, or leave out --board-shape.",
            )
        return progress.best is not None and progress.options.board_shape in (kind, "auto") and not several

    def make(progress: Progress) -> Change | None:
        flat, how = _flat(progress), replace(progress.how, board=kind)
        auto = progress.options.board_shape == "auto"
        try:
            made = refit(flat, flat.observations, how)
        except CamcalError:
            if auto:
                return None  # the data do not allow that kind
            raise
        trial = Trial(kind, made, board_shape.p_value(flat, made), None)
        return _tried(progress, flat, trial, how) if auto else _taken(flat, trial)

    return Attempt(kind, applies, make)


def _taken(flat: Estimate, trial: Trial) -> Change:
    notes = {"flat": flat, "shape": trial, "trials": ()}
    return Change(fit=Candidate(trial.calibration), instead=True, notes=notes)


def _tried(progress: Progress, flat: Estimate, trial: Trial, how: How) -> Change:
    """Compare a shape with the best board so far.

    It must be significant, and the free one leave a camera that is expected to be nearer to the truth; views are held
    out only then.
    """
    trials: tuple[Trial, ...] = progress.notes.get("trials", ())
    best = progress.best
    assert best is not None
    if not trials:
        held = hold_out(flat, progress.how)
        trials = (Trial("flat", flat, 1.0, held),)
        best = Candidate(flat, held)
    if trial.kind == "free":
        trial = replace(trial, change=_benefit(best.calibration, trial.calibration))
    refused = _refused(trial)
    if not refused:
        trial = replace(trial, holdout=hold_out(trial.calibration, how))
    notes = {"flat": flat, "trials": (*trials, trial), "shape": trial}
    fit = Candidate(trial.calibration, trial.holdout)
    return Change(fit=fit, best=best, refused=refused, notes=notes)


def _refused(trial: Trial) -> str:
    """Why a shape is not even compared; empty where it is."""
    if not trial.p_value < SIGNIFICANT:
        return f"a flat board would fit as well with probability {trial.p_value:.2g}"
    if trial.kind == "free" and not (trial.change is not None and trial.change.better):
        return "the camera is not expected to be nearer to the truth with every point free"
    return ""


def _benefit(simple: Estimate, shaped: Estimate) -> Benefit | None:
    try:
        return benefit(simple, shaped)
    except np.linalg.LinAlgError:
        return None  # a camera that the data do not determine gains nothing


def _reject_again(progress: Progress) -> Change | None:
    """A flat board's misfit may have made outliers of good points: test them again."""
    fit = progress.estimate
    assert fit.board is not None
    kept = robust.reject(fit, replace(progress.how, board=fit.board.kind))
    return None if kept is fit else Change(fit=Candidate(kept), instead=True)


def _is_shaped(progress: Progress) -> bool:
    return (
        progress.best is not None
        and progress.estimate.board is not None
        and progress.options.robust == "auto"
    )


def with_shape(data: Observations, progress: Progress) -> Observations:
    """The observations with the shape in their target, where shapes were tried."""
    trials: tuple[Trial, ...] = progress.notes.get("trials", ())
    fit, shape = progress.estimate, progress.notes.get("shape")
    if not trials and shape is None:
        return data
    target = dict(data.target or {})
    kind = "flat" if fit.board is None else fit.board.kind
    p = next((t.p_value for t in (*trials, shape) if t is not None and t.kind == kind), 1.0)
    target["shape"] = board_shape.described(fit, p, trials, float(target.get("square") or 1.0))
    return replace(data, target=target)


SHAPES: tuple[Attempt, ...] = (
    *(shape_attempt(kind) for kind in CANDIDATES),
    Attempt("rejected", _is_shaped, _reject_again),
)
