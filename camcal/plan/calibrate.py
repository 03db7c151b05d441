"""From observations to a solution: the plan, the warnings on its result, and the comparison with cv2."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import islice
from typing import Any

import numpy as np

from camcal import start
from camcal.assess import causes
from camcal.assess import outliers as foreign
from camcal.assess.checks import check
from camcal.assess.conditioning import with_conditioning
from camcal.assess.design import Design
from camcal.assess.fold_difference import difference_of_folds
from camcal.assess.holdout import described, folds_wanted, hold_out
from camcal.data.observations import Observations
from camcal.errors import CamcalError, DataError, EstimationError, UsageError, caught, only
from camcal.geometry import projective
from camcal.model.camera import Camera
from camcal.model.pose import Poses
from camcal.plan.boards import as_designed, with_shape
from camcal.plan.camera import run_closed_form, starts_from_nothing
from camcal.plan.held import held_at_start
from camcal.plan.known_camera import fully_known, placed
from camcal.plan.lens import solved_with_found_all
from camcal.plan.options import OnEvent, Options
from camcal.plan.progress import Progress, advance, follow_all
from camcal.plan.run import begun, plan, usable
from camcal.plan.solution import Solution, of_fit
from camcal.solve import outliers, ransac
from camcal.solve.calibration import Calibration, Stage
from camcal.solve.parameters import check_held
from camcal.solve.refine import How, residuals

#: cameras that are computed together: numpy's calls then cost little each, and the equations of as many (20 views, nine
#: parameters) take 4 MB
AT_A_TIME = 50


def calibrate(
    correspondences: Observations,
    model: str = "auto",
    robust: str = "none",
    on_event: OnEvent | None = None,
    **options: Any,
) -> Solution:
    """Calibrate a camera.

    Parameters
    ----------
    correspondences : Observations
    model : str
        A lens model, `camcal list models`; `auto` takes opencv5 where it holds and another where it does not, `select`
        ranks all models.
    robust : str
        How outliers are treated: `none`, `auto`, or the name of a loss.
    on_event : callable, optional
        Called as the work goes on: `("selected", {chosen, why, ...})`,
        `("refined", {rms_point, points, rejected})`, `("refined-points", {...})`,
        `("checked", {warnings})`, `("crosschecked", {entries})`.
    **options
        The fields of `camcal.settings.calibration.CalibrationOptions`, as on the command line; `checks=False`
        leaves out the search for reasons to warn.

    Returns
    -------
    Solution

    Raises
    ------
    UsageError
        For an unknown option, model or parameter, and for a value that does not fit.
    DataError
        For correspondences that cannot be used.
    EstimationError
        If they do not determine a camera.
    """
    asked = Options.resolve(model=model, robust=robust, **options)
    tell = on_event or _silent
    progress, selection = only(_followed([correspondences], asked))
    if selection is not None:
        tell("selected", selection)
    return _solved(progress, selection, asked, options, tell)


def calibrate_many(
    cameras: Iterable[Observations], model: str = "auto", robust: str = "none", **options: Any
) -> list[Solution | CamcalError]:
    """Calibrate many cameras in less time than one by one: those that are alike are computed together.

    The closed form and the refinement of the first lens model (the given one; opencv5 for `auto`) are computed
    together, for cameras with equally many views; with `checks=False` that is nearly everything. Every result is that
    of `calibrate`, to the last bit, whatever the other cameras are. The cameras are taken from the iterable some dozens
    at a time.

    Parameters
    ----------
    cameras : iterable of Observations
    model, robust, **options
        As of `calibrate`, the same for all.

    Returns
    -------
    list of Solution or CamcalError
        In the order of the cameras; the error in place of the result where a camera cannot be calibrated.

    Raises
    ------
    UsageError
        For an unknown option, model or parameter, and for a value that does not fit.

    What the iterable itself raises, such as an error of a file that it reads, is passed on: the results so far are
    lost.
    """
    asked = Options.resolve(model=model, robust=robust, **options)
    check_held(model, asked.skew, asked.fix)
    rest, found = iter(cameras), list[Solution | CamcalError]()
    while some := list(islice(rest, AT_A_TIME)):
        for one in _followed(some, asked):
            if isinstance(one, CamcalError):
                found.append(one)
            else:
                found.append(caught(_solved, *one, asked, options, _silent))
    return found


def _followed(
    cameras: Sequence[Observations], asked: Options
) -> list[tuple[Progress, Mapping[str, Any] | None] | CamcalError]:
    """The attempts that were made with each camera, and how its lens model was chosen if it was not given."""
    Observations.fit_shapes([one for one in cameras if isinstance(one, Observations)])
    known = fully_known(asked, None) is not None
    given = [caught(_usable, one, known) for one in cameras]
    sets = [one for one in given if not isinstance(one, CamcalError)]
    made: Sequence[tuple[Progress, Mapping[str, Any] | None] | CamcalError]
    if known:
        made = [caught(_placed, one, asked) for one in sets]
    elif asked.model in ("auto", "select"):
        made = solved_with_found_all(sets, asked)
    else:
        followed = follow_all(plan(), [begun(one, asked) for one in sets])
        made = [p if isinstance(p, CamcalError) else (p, None) for p in followed]
    results = iter(made)
    return [one if isinstance(one, CamcalError) else next(results) for one in given]


def _usable(given: Any, known: bool) -> Observations:
    """Check the type of the observations, then apply `usable`."""
    if not isinstance(given, Observations):
        raise UsageError(
            f"the observations of a camera are needed, not a {type(given).__name__}.",
            "camcal.read_points reads a table; camcal.calibrate_images takes pictures, camcal.calibrate_rig a rig.",
        )
    return usable(given, known)


def _placed(given: Observations, asked: Options) -> tuple[Progress, None]:
    """The poses with respect to a camera of which nothing is left to estimate."""
    camera = fully_known(asked, given.image_size)
    assert camera is not None
    return placed(camera, given, asked), None


def _silent(_: str, __: Mapping[str, Any]) -> None:
    """Ignore the event."""


def _solved(
    progress: Progress,
    selection: Mapping[str, Any] | None,
    asked: Options,
    options: Mapping[str, Any],
    tell: OnEvent,
) -> Solution:
    """The solution of a completed plan, assessed and compared with cv2 as requested."""
    second_pass = progress.notes.get("second_pass")
    if second_pass is not None:
        tell("refined-points", second_pass)
    solution = replace(_solution(progress), options=asked.described(options), selection=selection)
    rejected = int((~solution.used).sum())
    tell(
        "refined",
        {"rms_point": solution.rms_point, "points": progress.given.point_count, "rejected": rejected},
    )
    if asked.checks:
        solution = assessed(solution, progress)
        tell("checked", {"warnings": [w.code for w in solution.warnings]})
    if asked.crosscheck:
        solution = _crosschecked(solution, progress, asked.crosscheck == "full")
        tell("crosschecked", {"entries": len(solution.crosscheck)})
    return solution


def _crosschecked(solution: Solution, progress: Progress, full: bool) -> Solution:
    """The solution with cv2's results for its stages."""
    from camcal.peers.run import crosscheck  # cv2 is loaded only here

    made = crosscheck(solution, solution.stages, progress.how, _flat_before(progress), full)
    return replace(solution, crosscheck=made)


def first_estimate(
    correspondences: Observations,
    model: str = "opencv5",
    skew: bool = False,
    fix: Mapping[str, float | None] | None = None,
) -> tuple[Observations, Camera, Poses, How]:
    """The starting point of a refinement: usable views, camera, poses, and the settings of the fit.

    Raises
    ------
    DataError, EstimationError
        If no closed form finds a camera.
    """
    asked = Options.resolve(model=model, skew=skew, fix=fix or {})
    given = usable(correspondences)
    progress = advance(starts_from_nothing(), begun(given, asked))
    if progress.start is None:
        assert progress.error is not None
        raise progress.error
    return given, progress.start.camera, progress.start.poses, progress.how


def _flat_before(progress: Progress) -> dict[str, Calibration]:
    """The fit with a flat board, by the name of its stage, if the result has a board of another shape."""
    flat = progress.notes.get("flat")
    if flat is None or progress.fit.board is None:
        return {}
    name = next(s.name for s in progress.stages if s.camera is flat.camera)
    return {name: flat}


def _solution(progress: Progress) -> Solution:
    """The best fit with its stages; their figures are for the points that it uses."""
    fit = progress.fit
    info = dict(fit.fit.info)
    if "noise_model" in progress.notes:
        info["noise_model"] = progress.notes["noise_model"]
    if progress.options.robust == "auto" and "begun_from" in progress.notes:
        info["robust"] = _of_test(fit, progress.notes["begun_from"])
    fit = replace(
        fit,
        fit=replace(fit.fit, info=info),
        start=progress.start.camera if progress.start is not None else fit.start,
        observations=with_shape(fit.observations, progress),
    )
    # attempts were also made on points that agree, when in the end all were kept
    changed = len(fit.poses) < len(progress.given) or not fit.used.all() or progress.restarts > 0
    # the attempt that gave the result stands at the end, as `refine`; of a closed form on the same points one is kept
    before = [s for s in progress.stages if s.camera is not fit.camera]
    last = {s.name: s for s in before}
    before = [s for s in before if s.name not in start.CLOSED_FORMS or s is last[s.name]]
    stages = [s for s in (_on_result(stage, fit, progress, changed) for stage in before) if s]
    warnings = progress.start.warnings if progress.start is not None else ()
    if "shutter" in progress.notes:  # the points were corrected, which is reported even without checks
        warnings = (*warnings, progress.notes["shutter"])
    return of_fit(
        fit,
        stages=(*stages, _refine_stage(fit, [s.name for s in progress.stages if s.camera is fit.camera])),
        warnings=warnings,
        second_pass=progress.notes.get("second_pass"),
        points=progress.given,
    )


def _of_test(fit: Calibration, begun_from: str) -> dict[str, Any]:
    """How outliers were found, for the report's entry on the fit."""
    verdict = outliers.test(fit)
    return {
        "test": f"|r|²/2s² of a point exceeds F(2, nu) at {outliers.ALPHA:g}/N",
        "sigma": verdict.sigma,
        "threshold": verdict.threshold * verdict.sigma,
        "begun_from": begun_from,
        "ransac_confidence": ransac.CONFIDENCE,
    }


def _on_result(stage: Stage, fit: Calibration, progress: Progress, changed: bool) -> Stage | None:
    """A stage with its figure over the points of the result; a closed form is repeated on those.

    None where it has none: the closed form fails on them.
    """
    if not changed:
        return stage
    if stage.name in start.CLOSED_FORMS:
        try:
            on_kept = replace(progress, data=fit.observations, notes={})
            return run_closed_form(stage.name, on_kept)[1]
        except (EstimationError, DataError):
            return None
    return stage if stage.camera is None else replace(stage, rms_point=_rms_on(stage, fit, progress))


def _rms_on(stage: Stage, fit: Calibration, progress: Progress) -> float:
    """rms_point of a stage's camera and poses over the used points of the result; NaN if it lacks a view."""
    assert stage.camera is not None and stage.poses is not None
    names = stage.view_ids or progress.given.view_ids
    places = [names.index(v) if v in names else -1 for v in fit.observations.view_ids]
    if min(places) < 0 or len(stage.poses) != len(names):
        return float("nan")
    off = residuals(stage.camera, stage.poses[np.array(places)], fit.observations)[fit.used]
    return float(np.sqrt(np.square(off).sum(1).mean()))


def _refine_stage(fit: Calibration, names: list[str]) -> Stage:
    """The result as the last stage; `names` are the attempts that led to it."""
    projection = None
    if len(fit.poses) == 1:
        pose = fit.poses[0]
        projection = projective.compose(fit.camera.matrix, pose.rotation, pose.translation)
    return Stage(
        "refine",
        fit.rms_point,
        fit.camera.matrix,
        fit.fit.seconds,
        projection_matrix=projection,
        camera=fit.camera,
        poses=fit.poses,
        info={
            "converged": fit.fit.converged,
            "iterations": fit.fit.iterations,
            "attempt": names[-1] if names else None,
        },
    )


def assessed(solution: Solution, progress: Progress) -> Solution:
    """The solution with its hold-out, its warnings, and the condition of each stage's equations."""
    asked = progress.options
    known = progress.notes.get("causes")  # already searched for if views seemed not to belong
    found = known[1] if known and known[0] is progress.fit else causes.find(solution, progress.given)
    data, said = foreign.named(solution, progress.given, asked.robust != "none", found)
    solution = replace(solution, observations=data, warnings=(*solution.warnings, *said))
    folds = folds_wanted(solution, asked.holdout)
    how = replace(progress.how, board=solution.board.kind if solution.board else "flat")
    design = Design(solution)
    held = hold_out(solution, how, folds, design) if folds else None
    if held is not None:
        solution = replace(solution, holdout=described(held, difference_of_folds(solution, held)))
    warnings = (*check(solution, solution.warnings, solution.holdout, found, design), *as_designed(progress))
    if asked.start_camera is None:
        warnings = (*warnings, *held_at_start(asked.fix, solution.camera))
    solution = replace(solution, warnings=warnings)
    return replace(solution, stages=with_conditioning(solution.stages, solution, asked.normalise))
