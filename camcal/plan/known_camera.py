"""Evaluation of a known camera on data: its parameters are held, the pose of each view is refitted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from camcal.assess import outliers as foreign
from camcal.assess.known import Promise, check_known
from camcal.data.observations import Observations
from camcal.errors import DataError
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Poses
from camcal.plan.better import Candidate
from camcal.plan.camera import has_start_only
from camcal.plan.options import Options
from camcal.plan.outlying import AFTER_RESTART, wants_restart
from camcal.plan.progress import Attempt, Begin, Change, Progress, follow
from camcal.plan.solution import Solution, of_fit
from camcal.solve import ransac
from camcal.solve.refine import refine
from camcal.solve.robust import check_method
from camcal.start.known_pose import start_poses


def evaluate(
    camera: Camera,
    correspondences: Observations,
    robust: str = "none",
    seed: int = 0,
    promise: Promise | None = None,
) -> Solution:
    """Fit the pose of each view to a fixed camera.

    Parameters
    ----------
    camera : Camera
    correspondences : Observations
        Data that the camera was not calibrated with, or it judges itself.
    robust : str
        How outliers are treated, as in a calibration.
    seed : int
    promise : Promise, optional
        What the camera's own report says of its residuals: these are judged by it.

    Returns
    -------
    Solution
        With the given camera; residuals, poses and fit are of these data, warnings of what they say of each other.

    Raises
    ------
    DataError
        If the pictures are of another size than the camera's, or a view's points do not determine its pose.
    """
    _check_size(camera, correspondences)
    check_method(robust)
    options = Options(camera.lens.name, fix=dict.fromkeys(camera.lens.names), robust=robust, seed=seed)
    fit = placed(camera, correspondences, options).fit
    data, said = foreign.named(fit, correspondences, robust=False)
    fit = replace(fit, observations=data)
    return of_fit(fit, warnings=(*check_known(fit, correspondences, promise), *said))


def placed(camera: Camera, given: Observations, options: Options) -> Progress:
    """Run the attempts at the poses with respect to a known camera."""
    begin = Begin("given", camera, Poses.stack([]), float("nan"))
    return follow(_plan(begin), Progress(options, camera.lens, options.how(camera.lens), given, given))


def fully_known(options: Options, image_size: tuple[int, int] | None) -> Camera | None:
    """The camera if every parameter is held at a value; None if something remains to be estimated."""
    if options.model in ("auto", "select"):
        return None
    lens = lenses.make(options.model, options.skew)
    values = {name: options.fix.get(name) for name in lens.names}
    if any(v is None for v in values.values()):
        return None
    return Camera(
        lens, lens.from_values({n: float(v) for n, v in values.items() if v is not None}), image_size
    )


def _plan(known: Begin) -> tuple[Attempt, ...]:
    """The attempts at the poses with respect to a known camera."""

    def poses(progress: Progress) -> Change:
        kept = progress.data.kept()
        start = start_poses(known.camera, kept.views)
        return Change(start=Begin("poses", known.camera, start, float("nan")))

    def refined(progress: Progress) -> Change:
        assert progress.start is not None
        return Change(fit=Candidate(refine(known.camera, progress.start.poses, progress.data, progress.how)))

    def agreeing(progress: Progress) -> Change:
        found = ransac.of_poses(progress.data.views, known.camera, progress.options.seed)
        used = np.concatenate([a.mask for a in found])
        return Change(data=progress.data.with_used(used), again=True)

    def no_fit(progress: Progress) -> bool:
        return progress.best is None

    once = (Attempt("poses", no_fit, poses), Attempt("least-squares", has_start_only, refined))
    return (*once, Attempt("agreeing", wants_restart, agreeing), *once, *AFTER_RESTART)


def _check_size(camera: Camera, correspondences: Observations) -> None:
    ours, theirs = camera.image_size, correspondences.image_size
    if ours is not None and theirs is not None and tuple(ours) != tuple(theirs):
        raise DataError(
            f"the camera is for pictures of {ours[0]}x{ours[1]} px, but these have {theirs[0]}x{theirs[1]} px.",
            "Use pictures of the size used in the calibration.",
        )
