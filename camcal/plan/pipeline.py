"""The only place that knows the order: data, closed form, refinement, judgement, cross-check."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from camcal.assess import board_shape, conditioning, judgement, outliers
from camcal.assess.checks import check, still_true
from camcal.data.observations import Correspondences
from camcal.errors import DataError, EstimationError
from camcal.geometry import projective
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.lenses.containment import contained
from camcal.model.pose import Poses
from camcal.plan.start import Options, Start, first_camera, leave_out_unusable, masked, start
from camcal.solve import noise, ransac, starts
from camcal.solve import robust as robustly
from camcal.solve.losses import LOSSES
from camcal.solve.solution import Solution, Stage
from camcal.solve.solve import refine
from camcal.start import shape

#: called with (what happens, details) as the work goes on
OnEvent = Callable[[str, Mapping[str, Any]], None]


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
        Called as the work goes on: `("refined", {rms_point, points, rejected})`, `("checked", {warnings})`,
        `("crosschecked", {entries})`.
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
        Where they do not determine a camera.
    """
    told = Options.resolve(model=model, robust=robust, **options)
    solution = _calibrate(correspondences, told, on_event or _nobody)
    return replace(solution, options=told.described(options))


def _nobody(_: str, __: Mapping[str, Any]) -> None:
    """Listen to nothing."""


def _calibrate(correspondences: Correspondences, told: Options, tell: OnEvent = _nobody) -> Solution:
    usable = leave_out_unusable(correspondences)
    run = _Run(told, lenses.make(told.model, told.skew))
    solution = run.solve_weighted(usable)
    if told.robust == "auto":
        good = outliers.without_strangers(usable, solution)
        solution = solution if good is usable else run.solve_weighted(good)
    if len(solution.poses) < len(usable.views) or not all(m.all() for m in solution.inliers):
        run.begin_again(solution)
    stages = (*run.begun.stages, _refine_stage(solution))
    solution = replace(solution, stages=stages, warnings=run.begun.warnings)
    rejected = sum(int((~m).sum()) for m in solution.inliers)
    tell(
        "refined",
        {"rms_point": solution.rms_point, "points": usable.point_count, "rejected": rejected},
    )
    if told.checks:
        solution = outliers.named(solution, usable, told.robust != "none")
        solution = replace(solution, holdout=run.hold_out(solution))
        solution = replace(solution, warnings=(*still_true(solution), *check(solution)))
        solution = conditioning.with_conditioning(solution, told.normalise)
        tell("checked", {"warnings": [w.code for w in solution.warnings]})
    if told.crosscheck:
        solution = replace(solution, crosscheck=run.crosscheck(solution))
        tell("crosschecked", {"entries": len(solution.crosscheck)})
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
        chosen = masked(correspondences, masks)
        if self.aligned is None or self.aligned.correspondences is not chosen:
            self.aligned = starts.RadialAlignment(chosen)
        self.begun = start(chosen, self.told, self.lens, self.aligned)
        self.first, self.fix = first_camera(self.lens, self.begun, correspondences, self.told)
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
        for spec in contained(self.lens)[:1]:
            inner = lenses.make(spec, self.told.skew)
            told = replace(self.told, model=spec, fix={n: v for n, v in fix.items() if starts.has(inner, n)})
            run = _Run(told, inner)
            run.aligned = self.aligned
            with contextlib.suppress(EstimationError, DataError):
                _, camera, poses = run.begin(correspondences, more.get("inliers"))
                solved = run.fit(camera, poses, correspondences, **more)
                found.append(self.fit(*starts.adopted(self.lens, solved, self.fix), correspondences, **more))
        return found

    def solve_weighted(self, usable: Correspondences) -> Solution:
        """Solve, and again with the given sigmas where all views have them."""
        solution = self.solve(noise.unweighted(usable))
        return self.weighted(usable, solution) if all(v.sigma is not None for v in usable.views) else solution

    def solve(self, correspondences: Correspondences) -> Solution:
        """Camera, poses and, where told, the board's shape, with outliers treated as told."""
        planar = shape.shapes(correspondences.views).planar.tolist()
        told = self.told
        agree = partial(ransac.of_maps, planar=planar, seed=told.seed)
        flat = robustly.estimate(correspondences, self.begin, self.fit, agree, told.robust, told.seed)
        flat = self.truest(flat)
        return flat if told.board_shape == "flat" else self.with_shape(flat)

    def truest(self, found: Solution) -> Solution:
        """The best of the minima of a model that has several; which one is met depends on the start."""
        if not self.lens.several_minima or self.told.fix:
            return found
        tried, data = [found], found.correspondences
        whole = None
        if found.weights is not None:
            pairs = zip(found.weights, data.views, strict=True)
            whole = [w if v.sigma is None else w / v.sigma**2 for w, v in pairs]
        for camera in starts.twins(found):
            with contextlib.suppress(EstimationError):
                tried.append(self.fit(camera, found.poses, data, inliers=found.inliers, weights=whole))
        best = starts.best(tried)
        best = replace(best, fit=replace(best.fit, info={**found.fit.info, **best.fit.info}))
        if best.camera is found.camera or whole is None:
            return best if whole is None else found
        return robustly.reweight(best, self.fit, LOSSES[self.told.robust])

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

    def hold_out(self, solution: Solution) -> Mapping[str, Any] | None:
        """What views say that took no part."""
        more = {"options": self.told.stopping, "normalise": self.told.normalise}
        return judgement.hold_out(
            solution, self.fix, self.told.holdout, optimizer=self.told.optimizer, **more
        )

    def crosscheck(self, solution: Solution) -> tuple[Mapping[str, Any], ...]:
        """Every stage against cv2, which is loaded only here."""
        from camcal.peers.run import crosscheck

        def rerun(correspondences: Correspondences, skew: bool, board_shape: str = "flat") -> Solution:
            told = replace(
                self.told, robust="none", checks=False, crosscheck=False, skew=skew, board_shape=board_shape
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
