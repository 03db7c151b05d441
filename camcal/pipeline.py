"""The only place that knows the order: data, closed form, refinement, judgement, cross-check."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from camcal import lenses
from camcal.closed_form import CLOSED_FORMS, shape
from camcal.closed_form.base import ClosedForm
from camcal.errors import DataError, EstimationError
from camcal.evaluate import board_shape, conditioning, figures
from camcal.evaluate.checks import check
from camcal.geometry import projective
from camcal.refine import noise, ransac, starts
from camcal.refine import robust as robustly
from camcal.refine.optimizers.base import Options as Stopping
from camcal.refine.parameters import apply_fixed
from camcal.refine.solve import refine, residuals
from camcal.registry import look_up
from camcal.types import (
    CalibrationWarning,
    Camera,
    Correspondences,
    Poses,
    SkippedView,
    Solution,
    Stage,
)

#: called with (what happens, details) as the work goes on
OnEvent = Callable[[str, Mapping[str, Any]], None]


@dataclass(frozen=True)
class Options:
    """What a calibration is told; the command line's options by the same names."""

    model: str = "opencv5"
    skew: bool = False
    fix: Mapping[str, float | None] = field(default_factory=dict)
    optimizer: str = "lm"
    robust: str = "none"
    board_shape: str = "flat"
    checks: bool = True
    crosscheck: bool = False
    max_rms: float | None = None
    seed: int = 0
    normalise: bool = True
    stopping: Stopping = field(default_factory=Stopping)


def calibrate(
    correspondences: Correspondences,
    model: str = "opencv5",
    robust: str = "none",
    on_event: OnEvent | None = None,
    **options: Any,
) -> Solution:
    """Calibrate a camera.

    Parameters
    ----------
    correspondences : Correspondences
    model : str
        A lens model, `camcal list models`.
    robust : str
        How outliers are treated: `none`, `auto`, or the name of a loss.
    on_event : callable, optional
        Called with (name, details) at each stage.
    **options
        `skew`, `fix` (mapping name -> value or None), `optimizer`, `board_shape`, `crosscheck`, `seed`: as on
        the command line; `checks=False` leaves out the search for reasons to warn; `normalise=False` the
        centring and scaling of coordinates and columns at every stage.

    Returns
    -------
    Solution

    Raises
    ------
    UsageError
        For an unknown model or parameter.
    DataError
        For correspondences that cannot be used.
    EstimationError
        Where they do not determine a camera.
    """
    return _calibrate(correspondences, Options(model=model, robust=robust, **options))


def _calibrate(correspondences: Correspondences, told: Options) -> Solution:
    usable = leave_out_unusable(correspondences)
    run = _Run(told, lenses.make(told.model, told.skew))
    solution = run.solve(noise.unweighted(usable))
    if all(v.sigma is not None for v in usable.views):
        solution = run.weighted(usable, solution)
    if len(solution.poses) < len(usable.views) or not all(m.all() for m in solution.inliers):
        run.begin_again(solution)
    stages = (*run.begun.stages, _refine_stage(solution))
    solution = replace(solution, stages=stages, warnings=run.begun.warnings)
    if told.checks:
        solution = replace(solution, warnings=(*solution.warnings, *check(solution)))
        solution = conditioning.with_conditioning(solution, told.normalise)
    if told.crosscheck:
        solution = replace(solution, crosscheck=run.crosscheck(solution))
    return solution


class _Run:
    """One calibration under way: its options, and where its closed form ended."""

    def __init__(self, told: Options, lens: lenses.base.Lens):
        self.told, self.lens = told, lens
        self.begun: Start
        self.first: Camera | None = None
        self.aligned: starts.RadialAlignment | None = None
        self.fix: dict[str, float | None] = dict(told.fix)

    def begin(
        self, correspondences: Correspondences, masks: Sequence[np.ndarray] | None
    ) -> tuple[Correspondences, Camera, Poses]:
        """The closed form, on some of the points."""
        chosen = _masked(correspondences, masks)
        if self.aligned is None or self.aligned.correspondences is not chosen:
            self.aligned = starts.RadialAlignment(chosen)
        self.begun = start(chosen, self.told, self.lens, self.aligned)
        self.first, self.fix = _first_camera(self.lens, self.begun, correspondences, self.told)
        return correspondences, self.first, self.begun.poses

    def begin_again(self, solution: Solution) -> None:
        """The closed form on the points that a solution rests on: the stages of the report are of these."""
        before = self.begun
        try:
            self.begin(solution.correspondences, solution.inliers)
        except (EstimationError, DataError):  # none that compares with the solution
            self.begun = replace(before, stages=())

    def fit(self, start: Camera, poses: Poses, correspondences: Correspondences, **more: Any) -> Solution:
        """The refinement with the options of this calibration; the first one may have second thoughts.

        Not before outliers were looked for, if they are to be: a fit to them is doubtful from wherever it
        begins.
        """
        more = {"options": self.told.stopping, "normalise": self.told.normalise, **more}
        if start is not self.first or (self.told.robust != "none" and "inliers" not in more):
            return refine(start, poses, correspondences, self.fix, self.told.optimizer, **more)
        try:
            solution = refine(start, poses, correspondences, self.fix, self.told.optimizer, **more)
        except EstimationError:
            if not (found := self._from_elsewhere(correspondences, more)):
                raise
            return starts.best(found)
        if not starts.doubtful(solution):
            return solution
        return starts.best([solution, *self._from_elsewhere(correspondences, more)])

    def _from_elsewhere(self, correspondences: Correspondences, more: Mapping[str, Any]) -> list[Solution]:
        """The refinement from other starts: radial alignment, and the optima of the models in this one."""
        assert self.aligned is not None
        fix, found = dict(self.told.fix), []
        with contextlib.suppress(EstimationError, DataError):
            begins = self.aligned.begin(self.lens, fix)
            for begun in begins[0 if self.begun.camera is None else 1 :]:
                found.append(self.fit(begun.camera, begun.poses, correspondences, **more))
        for spec in self.lens.nests()[:1]:
            inner = lenses.make(spec, self.told.skew)
            told = replace(self.told, model=spec, fix={n: v for n, v in fix.items() if starts.has(inner, n)})
            run = _Run(told, inner)
            run.aligned = self.aligned
            with contextlib.suppress(EstimationError, DataError):
                _, camera, poses = run.begin(correspondences, more.get("inliers"))
                solved = run.fit(camera, poses, correspondences, **more)
                found.append(self.fit(*starts.adopted(self.lens, solved, self.fix), correspondences, **more))
        return found

    def solve(self, correspondences: Correspondences) -> Solution:
        """Camera, poses and, where told, the board's shape, with outliers treated as told."""
        planar = shape.shapes(correspondences.views).planar.tolist()
        told = self.told
        agree = partial(ransac.of_maps, planar=planar, seed=told.seed)
        flat = robustly.estimate(correspondences, self.begin, self.fit, agree, told.robust, told.seed)
        return flat if told.board_shape == "flat" else self.with_shape(flat)

    def weighted(self, usable: Correspondences, first: Solution) -> Solution:
        """Solve again with the given sigmas as far as the first solution's residuals bear them out."""
        given = {v.id: v.sigma for v in usable.views if v.sigma is not None}
        model = noise.noise_model(first, given)
        again = self.solve(noise.with_model(usable, model))
        info = {**again.fit.info, "noise_model": {"scale": model.scale, "floor_px": model.floor}}
        return replace(again, fit=replace(again.fit, info=info))

    def with_shape(self, flat: Solution) -> Solution:
        """The solution with the board's shape estimated along, where that is to be believed."""
        ideal = flat.correspondences

        def fit(kind: str, data: Correspondences, poses: Poses, inliers: Sequence[np.ndarray]) -> Solution:
            return self.fit(flat.camera, poses, data, inliers=inliers, board_shape=kind)

        if self.told.board_shape == "auto":
            best, trials = board_shape.choose(flat, ideal, fit)
        else:
            shaped = fit(self.told.board_shape, ideal, flat.poses, flat.inliers)
            best, trials = (
                board_shape.Trial(self.told.board_shape, shaped, board_shape.p_value(flat, shaped), None),
                (),
            )
        if best.kind == "flat" or self.told.robust == "none":
            return replace(board_shape.with_shape(best, trials), start=flat.start)
        # a flat board's misfit may have made outliers of good points: judge them again
        again = robustly.reject(best.solution, partial(self.fit, board_shape=best.kind), ideal)
        return replace(board_shape.with_shape(replace(best, solution=again), trials), start=flat.start)

    def crosscheck(self, solution: Solution) -> tuple[Mapping[str, Any], ...]:
        """Every stage against cv2, which is loaded only here."""
        from camcal.crosscheck.run import crosscheck

        def rerun(correspondences: Correspondences, skew: bool) -> Solution:
            told = replace(
                self.told, robust="none", checks=False, crosscheck=False, skew=skew, board_shape="flat"
            )
            return _calibrate(correspondences, told)

        return crosscheck(solution, rerun)


def first_estimate(
    correspondences: Correspondences,
    model: str = "opencv5",
    skew: bool = False,
    fix: Mapping[str, float | None] | None = None,
) -> tuple[Correspondences, Camera, Poses, dict[str, float | None]]:
    """Where a refinement would begin: usable views, camera, poses, and all parameters that are held."""
    told = Options(model=model, skew=skew, fix=fix or {})
    run = _Run(told, lenses.make(model, skew))
    usable, camera, poses = run.begin(leave_out_unusable(correspondences), None)
    return usable, camera, poses, run.fix


def leave_out_unusable(correspondences: Correspondences) -> Correspondences:
    """The correspondences without views that no closed form can take; these become `rejected`.

    Raises
    ------
    DataError
        Where none is left.
    """
    bad = shape.unusable(correspondences)
    if len(bad) == len(correspondences.views):
        shape.check(correspondences)  # raises, with the reason of the first view
    if not bad:
        return correspondences
    views = correspondences.views
    skipped = tuple(SkippedView(views[i].id, "rejected", reason) for i, reason in bad.items())
    return replace(
        correspondences,
        views=tuple(v for i, v in enumerate(views) if i not in bad),
        skipped=(*correspondences.skipped, *skipped),
    )


@dataclass(frozen=True)
class Start:
    """Where the closed forms end: a pinhole camera, poses, and how they were reached."""

    matrix: np.ndarray
    poses: Poses
    stages: tuple[Stage, ...]
    fix: Mapping[str, float | None]
    warnings: tuple[CalibrationWarning, ...]
    camera: Camera | None = None  #: of the lens itself, where the start knows more than a matrix


def _masked(correspondences: Correspondences, masks: Sequence[np.ndarray] | None) -> Correspondences:
    """The correspondences with only the points that the masks let through."""
    if masks is None:
        return correspondences
    kept = tuple(v.take(m) for v, m in zip(correspondences.views, masks, strict=True))
    return replace(correspondences, views=kept)


def start(
    correspondences: Correspondences,
    told: Options,
    lens: lenses.base.Lens,
    aligned: starts.RadialAlignment,
) -> Start:
    """Run the closed forms that the geometry of the data allows; the last is where the refinement starts.

    Where that one takes a wide lens for a pinhole camera, or fails, radial alignment takes over.
    """
    names, why = shape.choose(correspondences)
    stages: list[Stage] = []
    found = None
    failed: dict[str, str] = {}
    for name in names:
        estimate = look_up(CLOSED_FORMS, name, "closed form")
        begin = time.perf_counter()
        try:
            found = estimate(correspondences, told.skew, told.normalise)
        except EstimationError as error:
            if name == names[-1]:
                if wide := _by_radial_alignment(lens, aligned, told, stages):
                    return wide
                raise
            failed[name] = error.message  # another closed form may do without what this one lacks
            continue
        seconds = time.perf_counter() - begin
        stages.append(_closed_form_stage(found, correspondences, why, seconds, failed))
    assert found is not None
    _refuse_mirrored(found)
    if lens.shaped_by_data or starts.poor(stages[-1].rms_point, correspondences):
        wide = _by_radial_alignment(lens, aligned, told, stages)
        if wide is not None and wide.stages[-1].rms_point < stages[-1].rms_point:
            return wide
    fix, warnings = _assumed(found, correspondences)
    camera = None
    if lens.shaped_by_data:
        plain = lenses.make("pinhole", told.skew)
        rough = Camera(plain, plain.from_matrix(found.matrix), correspondences.image_size)
        camera = starts.regressed(lens, rough, correspondences, told.fix)
    return Start(found.matrix, found.poses, tuple(stages), fix, warnings, camera)


def _by_radial_alignment(
    lens: lenses.base.Lens, aligned: starts.RadialAlignment, told: Options, stages: Sequence[Stage]
) -> Start | None:
    """The start for wide lenses, after the stages before it; None where it finds no camera."""
    try:
        begun = next(iter(aligned.begin(lens, told.fix)), None)
    except (EstimationError, DataError):
        return None  # the closed form before it has its say, or its error
    if begun is None:
        return None
    return Start(begun.camera.matrix, begun.poses, (*stages, begun.stage), {}, (), begun.camera)


def _closed_form_stage(
    found: ClosedForm, correspondences: Correspondences, why: str, seconds: float, failed: Mapping[str, str]
) -> Stage:
    if found.projection_matrix is not None:
        view = correspondences.views[0]
        rms = figures.rms_point(projective.project(found.projection_matrix, view.xyz) - view.uv)
    else:
        lens = lenses.make("pinhole", skew=True)
        camera = Camera(lens, lens.from_matrix(found.matrix))
        rms = figures.rms_point(np.concatenate(residuals(camera, found.poses, correspondences)))
    return Stage(
        found.name,
        rms,
        found.matrix,
        seconds,
        projection_matrix=found.projection_matrix,
        poses=found.poses,
        info={"why": why, **found.info, **({"failed_before": dict(failed)} if failed else {})},
    )


def _refuse_mirrored(found: ClosedForm) -> None:
    if found.info.get("mirrored"):
        raise DataError(
            "the frame of the points is left-handed (mirrored): the scene lies in front of the camera only "
            "with a reflection.",
            "Negate one axis of the points, for example Z, or swap two of them.",
        )


def _assumed(
    found: ClosedForm, correspondences: Correspondences
) -> tuple[dict[str, float | None], tuple[CalibrationWarning, ...]]:
    """What a single view of a plane leaves open is held at the closed form's assumption, and said."""
    warnings = []
    if found.info.get("degenerate"):
        warnings.append(
            CalibrationWarning(
                "weak-geometry",
                f"the closed form is hardly determined by these views: {found.info['degenerate']}.",
                "Add views of the target tilted by 20 to 45 degrees in different directions.",
            )
        )
    held: dict[str, float | None] = dict.fromkeys(found.info.get("held", ()))
    if not held or shape.distinct(correspondences.views) > 1:
        return {}, tuple(warnings)
    said = CalibrationWarning(
        "single-view",
        "one view of a plane does not determine the camera; assumed: "
        + ", ".join(found.info["assumptions"])
        + ".",
        "Add views of the target from other directions.",
    )
    return held, (said, *warnings)


def _first_camera(
    lens: lenses.base.Lens, begun: Start, correspondences: Correspondences, told: Options
) -> tuple[Camera, dict[str, float | None]]:
    fix = {**dict.fromkeys(lens.default_fixed), **begun.fix, **told.fix}
    params = lens.from_matrix(begun.matrix) if begun.camera is None else begun.camera.params
    return Camera(lens, apply_fixed(lens, params, fix), correspondences.image_size), fix


def _refine_stage(solution: Solution) -> Stage:
    matrix = solution.camera.matrix
    single = len(solution.poses) == 1
    projection = None
    if single:
        pose = solution.poses[0]
        projection = projective.compose(matrix, pose.rotation, pose.translation)
    return Stage(
        "refine",
        solution.rms_point,
        matrix,
        solution.fit.seconds,
        projection_matrix=projection,
        camera=solution.camera,
        poses=solution.poses,
        info={"converged": solution.fit.converged, "iterations": solution.fit.iterations},
    )
