"""Attempts to explain the residuals of a flat, still board: a rolling shutter, then the shape: bowl, print, free."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from camcal.assess import board_shape, half_turns, rolling
from camcal.assess.board_shape import CANDIDATES, SIGNIFICANT, Trial
from camcal.assess.checks import film
from camcal.assess.holdout import hold_out
from camcal.assess.shape_benefit import Change as Benefit
from camcal.assess.shape_benefit import change as benefit
from camcal.assess.warning import CalibrationWarning
from camcal.data.boards import labels, names_of
from camcal.data.observations import Observations
from camcal.errors import CamcalError
from camcal.plan.better import Candidate, better
from camcal.plan.progress import Attempt, Change, Progress, stage_of
from camcal.solve import robust
from camcal.solve.board import PLACED
from camcal.solve.calibration import Calibration, Estimate, Stage
from camcal.solve.refine import How, refit
from camcal.solve.several_boards import LEAST_POINTS, LEAST_VIEWS, Several, enough, kinds_of
from camcal.system.text import listed

#: steps to a readout time at most: the first is off by .02 of .8 frames, the second by less than its sigma
READOUT_STEPS = 4


def _flat(progress: Progress) -> Estimate:
    """The fit with the board as designed, to which shapes are compared."""
    found = progress.notes.get("flat")
    return found if isinstance(found, Estimate) else progress.estimate


def _several_boards(progress: Progress) -> bool:
    return labels(progress.given) is not None


def as_designed(progress: Progress) -> tuple[CalibrationWarning, ...]:
    """A note on those of several boards whose shape the views do not determine; empty if no shape is requested."""
    data = progress.estimate.observations.kept()
    several = Several.of(data)
    if progress.options.board_shape == "flat" or several is None:
        return ()
    names = names_of(data.target)
    lacking = [names[k] for k in np.flatnonzero(~enough(data, several))]
    if not lacking:
        return ()
    one = len(lacking) == 1
    return (
        CalibrationWarning(
            "boards-as-designed",
            f"fewer than {LEAST_POINTS} points are seen in {LEAST_VIEWS} views of {'board' if one else 'boards'} "
            f"{listed(lacking)}, whose shape is not estimated: {'it is' if one else 'they are'} assumed "
            f"to be as designed.",
            f"Take {LEAST_VIEWS} or more pictures of {'it' if one else 'each'}.",
            "note",
        ),
    )


def _shape_tells(progress: Progress) -> bool:
    wanted = progress.options.board_shape in ("free", "auto") or _known_shape(progress)
    return progress.best is not None and wanted and not _several_boards(progress)


def _known_shape(progress: Progress) -> bool:
    return ((progress.given.target or {}).get("shape") or {}).get("kind") == "known"


def _turn(progress: Progress) -> Change | None:
    """Renumber views so that all count the points of a board with half-turn symmetry from the same end.

    Otherwise its shape would be mixed with itself upside down. Other shapes than the free one are the same either way.
    """
    flat = _flat(progress)
    try:
        if not _known_shape(progress):
            found = half_turns.decided(flat, progress.how)
        else:
            found = half_turns.decided_by_known(flat, progress.how) if isinstance(flat, Calibration) else None
    except CamcalError:
        return None  # the data do not allow a free board
    if found is None:
        return None
    stage = stage_of("turned-views", found.fit, 0.0, {"kept": True, "views": list(found.views)})
    return Change(
        fit=Candidate(found.fit),
        instead=True,
        given=half_turns.renamed(progress.given, found.views, found.turn),
        stage=stage,
        before=tuple(_after_turn(s, progress, found) for s in progress.stages),
        notes={"turned": found.views},
    )


def _after_turn(stage: Stage, progress: Progress, found: half_turns.Turned) -> Stage:
    """A stage whose poses are those of the board renumbered."""
    names = stage.view_ids or progress.given.view_ids
    if stage.poses is None or len(stage.poses) != len(names):
        return stage
    return replace(stage, poses=half_turns.turned(stage.poses, names, found.views, found.turn))


def _shutter_tells(progress: Progress) -> bool:
    flat = _flat_fit(progress)
    return isinstance(flat, Calibration) and rolling.known_motion(flat.observations)


def _flat_fit(progress: Progress) -> Estimate | None:
    return None if progress.best is None or progress.estimate.board is not None else progress.estimate


def _shutter(progress: Progress) -> Change | None:
    """Test a rolling shutter first, since a board of free shape could absorb the motion.

    The flat board is fitted to points corrected for the readout time that its residuals show. Where that is better than
    without, the points stay corrected: a shape then has to be better than the shutter alone.
    """
    flat = _flat_fit(progress)
    assert isinstance(flat, Calibration)
    found = rolling.sure(flat)
    if found is None:
        return None
    time, made = _corrected_fit(flat, found.time, progress.how)
    found = replace(found, time=time)
    best, shutter = (Candidate(fit, hold_out(fit, progress.how)) for fit in (flat, made))
    kept, why = better(shutter, best)
    if not kept:
        return Change(fit=shutter, best=best, refused=why)
    return Change(
        fit=shutter,
        instead=True,
        given=rolling.corrected(progress.given, found.time),
        notes={"shutter": film.corrected_for(found, rolling.effect_px(flat, found))},
    )


def _corrected_fit(flat: Calibration, time: float, how: How) -> tuple[float, Calibration]:
    """The readout time to which linear steps from the first lead, and the fit to points corrected for it."""
    step = 0.0
    for _ in range(READOUT_STEPS):
        time += step
        made = refit(flat, rolling.corrected(flat.observations, time), how)
        left = rolling.readout(made)
        if left is None or abs(left.time) < left.sigma:
            break
        step = left.time
    return time, made


def shape_attempt(kind: str) -> Attempt:
    """The attempt with a kind of shape: accepted if it was requested, otherwise only if it is better."""

    def applies(progress: Progress) -> bool:
        return progress.best is not None and progress.options.board_shape in (kind, "auto")

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
        held = best.holdout or hold_out(flat, progress.how)
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


def _each_applies(progress: Progress) -> bool:
    board = None if progress.best is None else progress.estimate.board
    shaped = board is not None and board.kind != PLACED
    return shaped and progress.options.board_shape == "auto" and _several_boards(progress)


def _each(progress: Progress) -> Change | None:
    """Another kind of shape for one board at a time, if that is better; a board that needs none stays flat."""
    assert progress.best is not None
    best, several = progress.best, Several.of(progress.estimate.observations.kept())
    assert several is not None and best.calibration.board is not None
    kinds = list(kinds_of(best.calibration.board.kind, len(several.frames)))
    trials: tuple[Trial, ...] = progress.notes.get("trials", ())
    begin = best
    for board in np.flatnonzero(enough(progress.estimate.observations.kept(), several)).tolist():
        for kind in ("flat", *CANDIDATES):
            tried = "+".join([*kinds[:board], kind, *kinds[board + 1 :]])
            trial = _one_board(tried, best, progress) if kind != kinds[board] else None
            if trial is None:
                continue
            trials = (*trials, trial)
            candidate = Candidate(trial.calibration, trial.holdout)
            if trial.holdout is not None and better(candidate, best)[0]:
                best, kinds[board] = candidate, kind
    if best is begin:
        return Change(notes={"trials": trials})
    taken = next(t for t in trials if t.calibration is best.calibration)
    return Change(fit=best, instead=True, notes={"trials": trials, "shape": taken})


def _one_board(kinds: str, best: Candidate, progress: Progress) -> Trial | None:
    """A trial with one kind for each board; None if the data do not allow it, without a hold-out if refused."""
    flat, how = _flat(progress), replace(progress.how, board=kinds)
    if not set(kinds.split("+")) & set(CANDIDATES):
        return None  # all flat: compared before
    try:
        made = refit(flat, flat.observations, how)
    except CamcalError:
        return None
    simpler = made.free_count < best.calibration.free_count
    p = board_shape.p_value(flat, made)
    trial = Trial(kinds, made, p if simpler else board_shape.p_value(best.calibration, made), None)
    if not simpler:
        trial = replace(trial, change=_benefit(best.calibration, made))
        if not trial.p_value < SIGNIFICANT or trial.change is None or not trial.change.better:
            return trial
    return replace(trial, p_value=p, holdout=hold_out(made, how))


def _refused(trial: Trial) -> str:
    """The reason why a shape is not compared; empty if it is."""
    if not trial.p_value < SIGNIFICANT:
        return f"the p-value of a flat board is {trial.p_value:.2g}"
    if trial.kind == "free" and not (trial.change is not None and trial.change.better):
        return "estimating every point is not expected to improve the camera"
    return ""


def _benefit(simple: Estimate, shaped: Estimate) -> Benefit | None:
    try:
        return benefit(simple, shaped)
    except np.linalg.LinAlgError:
        return None  # a camera that the data do not determine gains nothing


def _reject_again(progress: Progress) -> Change | None:
    """Repeat the outlier test, since a flat board's misfit may have made good points look like outliers."""
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
    """The observations with the shape in their target, if shapes were tried."""
    trials: tuple[Trial, ...] = progress.notes.get("trials", ())
    fit, shape = progress.estimate, progress.notes.get("shape")
    target, turned = dict(data.target or {}), list(progress.notes.get("turned", ()))
    if not trials and shape is None:
        more = {"shape": {**target["shape"], "turned": turned}} if turned else {}
        return replace(data, target={**target, **more}) if more else data
    kind = "flat" if fit.board is None or fit.board.kind == PLACED else fit.board.kind
    p = next((t.p_value for t in (*trials, shape) if t is not None and t.kind == kind), 1.0)
    target["shape"] = board_shape.described(fit, p, trials, float(target.get("square") or 1.0))
    if turned:
        target["shape"]["turned"] = turned
    return replace(data, target=target)


SHAPES: tuple[Attempt, ...] = (
    Attempt("rolling-shutter", _shutter_tells, _shutter),
    Attempt("turned-views", _shape_tells, _turn),
    *(shape_attempt(kind) for kind in CANDIDATES),
    Attempt("each-board", _each_applies, _each),
    Attempt("rejected", _is_shaped, _reject_again),
)
