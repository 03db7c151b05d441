"""From the observations of several cameras to a rig.

Each camera alone, then the relative poses by a spanning tree over shared instants, then everything together: a plan of
attempts as that of one camera, with the same least squares, outlier test, board shapes and rule for what is better.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

import numpy as np

from camcal.assess.holdout import described, folds_wanted, hold_out
from camcal.assess.rig_checks import check, out_of_step
from camcal.data.observations import Observations
from camcal.data.rig_table import RigViews, joined
from camcal.errors import EstimationError
from camcal.model.rig import Rig
from camcal.plan.better import Candidate
from camcal.plan.boards import SHAPES, as_designed, with_shape
from camcal.plan.held import held_at_start
from camcal.plan.options import OnEvent, Options
from camcal.plan.outlying import LOSS, LOSS_ROUNDS
from camcal.plan.progress import Attempt, Change, Progress, advance, follow
from camcal.plan.rig_boards import Layout, arranged
from camcal.plan.rig_cameras import Alone, alone, check_options, fixed_of, pictures_of
from camcal.plan.solution import RigSolution
from camcal.settings.rig import RigOptions
from camcal.solve import outliers, robust
from camcal.solve.calibration import RigCalibration, Stage
from camcal.solve.losses import LOSSES
from camcal.solve.refine import How, board_kind, refine, residuals
from camcal.solve.rig_lags import lags
from camcal.solve.rig_start import Links, corners_of, links, placed, spanning_tree
from camcal.solve.turns import symmetries


def calibrate_rig(
    data: Observations | Mapping[str, Observations] | RigViews,
    *,
    on_event: OnEvent | None = None,
    refine_points: bool | None = False,
    **options: Any,
) -> RigSolution:
    """Calibrate a rig: all cameras, their relative poses, and the boards, together.

    Parameters
    ----------
    data : Observations of several cameras, or mapping of name -> Observations
        Views of the same id are of the same instant. `camcal.read_rig(path)` reads a table with a column `camera`.
    on_event : callable, optional
        Called as the work goes on: `("camera", {name, rms_point, model})`, `("linked", {...})`,
        `("refined", {rms_point, points, rejected})`, `("crosschecked", {entries})`.
    **options
        The fields of `camcal.settings.rig.RigOptions`, as on the command line: `model` (of all, or a mapping by
        camera), `cameras` (a mapping of name -> Camera or file), `hold`, `reference`, `robust`, `board_shape`, ...

    Returns
    -------
    RigSolution

    Raises
    ------
    UsageError
        For an unknown option, model, parameter or camera.
    DataError
        For observations that cannot be used.
    EstimationError
        If they do not determine a camera, or do not connect the cameras.
    """
    asked = RigOptions.resolve(**options)
    tell = on_event or (lambda _, __: None)
    views = RigViews.of(data)
    names = tuple(views.parts)
    check_options(asked, names)
    reference = asked.reference or names[0]
    views = views.ordered(reference).shifted(asked.lag)
    cameras = _each_alone(views, asked, refine_points, tell)
    fits, views, placed = arranged({n: a.fit for n, a in cameras.items()}, views, asked.boards)
    cameras = {n: replace(a, fit=fits[n]) for n, a in cameras.items()}
    progress = _followed(_begun(cameras, views, asked, placed))
    solution = _solution(progress, cameras, asked)
    tell("refined", {"rms_point": solution.rms_point, "rejected": int((~solution.used).sum())})
    solution = replace(solution, options=asked.described(options))
    if asked.checks:
        solution = _assessed(solution, progress, asked)
    if asked.crosscheck:
        from camcal.peers.stereo_calibrate import crosscheck  # cv2 is loaded only here

        flat = progress.notes.get("flat")
        solution = replace(solution, crosscheck=crosscheck(solution, flat, progress.how))
        tell("crosschecked", {"entries": len(solution.crosscheck)})
    return solution


def _each_alone(
    views: RigViews, asked: RigOptions, refine_points: bool | None, tell: OnEvent
) -> dict[str, Alone]:
    """Each camera calibrated by its own views."""
    cameras = {}
    for name, part in views.parts.items():
        cameras[name] = alone(name, part, asked, refine_points)
        fit = cameras[name].fit
        tell("camera", {"name": name, "rms_point": fit.rms_point, "model": fit.camera.lens.name})
    return cameras


# ------------------------------------------------------------------------------------------------------ the plan
def _begun(
    cameras: Mapping[str, Alone], views: RigViews, asked: RigOptions, placed: Layout | None
) -> Progress:
    """The progress before the cameras are combined."""
    parts = {n: a.fit.observations for n, a in cameras.items()}
    data = joined(parts, views.instants, views.order)
    if asked.robust in ("none", "auto"):
        data = replace(data, weight=None)
    fix = {f"{n}.{p}": v for n, a in cameras.items() for p, v in a.fix.items()}
    options = Options.of_rig(asked)
    how = How(fix, options.optimizer, options.stopping, options.normalise, board_kind(data))
    first = next(iter(cameras.values())).fit.camera.lens
    notes = {"cameras": cameras, "pictures": pictures_of({n: a.fit for n, a in cameras.items()}, views, data)}
    notes["layout"] = placed
    return Progress(options, first, how, data, data, notes=notes)


def _followed(begun: Progress) -> Progress:
    """Make all attempts of the plan; if they fail, name cameras that lag."""
    progress = advance(PLAN, begun)
    late = progress.notes.get("lags")
    if progress.best is None and late:
        said = out_of_step(late)
        raise EstimationError(said.message, said.hint)
    return follow((), progress)


def _link(progress: Progress) -> Change:
    """The relative poses of the cameras, and the boards before them, from each camera alone."""
    begin = time.perf_counter()
    data, pictures = progress.data, progress.notes["pictures"]
    turns, corners = symmetries(data), corners_of(data.xyz)
    known = links(pictures, turns, corners, len(data.cameras))
    relative, tree = spanning_tree(known, data.cameras)
    data, poses, turned = placed(pictures, relative, data, turns, corners)
    cameras = {n: a.fit.camera for n, a in progress.notes["cameras"].items()}
    rig = Rig(cameras, dict(zip(cameras, relative, strict=True)), data.cameras[0])
    off = residuals(rig, poses, data)[data.used]
    boards: Layout | None = progress.notes["layout"]
    turned += 0 if boards is None else boards.turned_pictures
    info: dict[str, Any] = {
        "tree": [f"{data.cameras[a]}-{data.cameras[b]}" for a, b in tree],
        "turned_pictures": turned,
    }
    if boards is not None and boards.found:
        info["boards"] = list(boards.found)
    rms = float(np.sqrt(np.square(off).sum(1).mean()))
    late = {data.cameras[c]: n for c, n in lags(pictures, known, tree, turns, corners).items()}
    if late:
        info["lags"] = late
    stage = Stage("spanning-tree", rms, None, time.perf_counter() - begin, info=info)
    notes = {"rig": rig, "poses": poses, "links": known, "lags": late}
    return Change(data=data, given=data, stage=stage, notes=notes)


def _together(progress: Progress) -> Change:
    """The joint fit, on the points kept by the cameras alone."""
    rig, poses = progress.notes["rig"], progress.notes["poses"]
    return Change(fit=Candidate(refine(rig, poses, progress.data, progress.how)))


def _reweight(progress: Progress) -> Change:
    method = progress.options.robust
    auto = method == "auto"
    rounds = {"rounds": LOSS_ROUNDS} if auto else {}
    made = robust.reweight(progress.estimate, progress.how, LOSSES[LOSS if auto else method], **rounds)
    return Change(fit=Candidate(made), instead=True)


def _wants_reweighting(progress: Progress) -> bool:
    method = progress.options.robust
    if progress.best is None or method == "none":
        return False
    return method != "auto" or not outliers.is_clean(progress.estimate)


def _rejects(progress: Progress) -> bool:
    return progress.best is not None and progress.options.robust == "auto"


def _reject(progress: Progress) -> Change | None:
    kept = robust.reject(progress.estimate, progress.how)
    return None if kept is progress.estimate else Change(fit=Candidate(kept), instead=True)


#: the attempts at a rig whose cameras are known individually, in order
PLAN: tuple[Attempt, ...] = (
    Attempt("spanning-tree", lambda p: p.best is None, _link),
    Attempt("together", lambda p: p.best is None and "rig" in p.notes, _together),
    Attempt("reweighted", _wants_reweighting, _reweight),
    Attempt("rejected", _rejects, _reject),
    *SHAPES,
)


# ---------------------------------------------------------------------------------------------------- the result
def _solution(progress: Progress, cameras: Mapping[str, Alone], asked: RigOptions) -> RigSolution:
    """The best fit with its stages."""
    fit = progress.estimate
    assert isinstance(fit, RigCalibration)
    fit = replace(fit, observations=with_shape(fit.observations, progress))
    own = [_stage_alone(a) for a in cameras.values()]
    last = Stage("refine", fit.rms_point, None, fit.fit.seconds, info={"converged": fit.fit.converged})
    selection = {n: a.selection for n, a in cameras.items() if a.selection is not None}
    return RigSolution(
        **{f.name: getattr(fit, f.name) for f in fields(RigCalibration)},
        stages=(*own, *progress.stages, last),
        selection=selection or None,
        links=_described(progress.notes["links"], fit.observations.cameras),
    )


def _stage_alone(own: Alone) -> Stage:
    fit = own.fit
    info: dict[str, Any] = {"camera": own.name}
    if own.second_pass is not None:
        info["second_pass"] = own.second_pass
    return Stage("alone", fit.rms_point, fit.camera.matrix, fit.fit.seconds, camera=fit.camera, info=info)


def _described(found: Links, names: tuple[str, ...]) -> dict[tuple[str, str], dict[str, Any]]:
    return {(names[a], names[b]): {"instants": k.shared, "scatter": k.scatter} for (a, b), k in found.items()}


def _assessed(solution: RigSolution, progress: Progress, asked: RigOptions) -> RigSolution:
    """The solution with its hold-out and its warnings."""
    folds = folds_wanted(solution, asked.holdout)
    how = replace(progress.how, board=solution.board.kind if solution.board else "flat")
    held = hold_out(solution, how, folds) if folds else None
    if held is not None:
        solution = replace(solution, holdout=described(held, None))
    fixed = [
        warning
        for name, camera in solution.rig.cameras.items()
        if name not in asked.cameras
        for warning in held_at_start(fixed_of(name, camera.lens.name, asked), camera, name)
    ]
    return replace(
        solution, warnings=(*check(solution, progress.notes["lags"]), *as_designed(progress), *fixed)
    )
