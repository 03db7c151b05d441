"""Where a calibration begins: what is told, which views can be used, and the closed forms in their order."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from camcal.assess import figures
from camcal.data.observations import Correspondences, SkippedView
from camcal.errors import DataError, EstimationError
from camcal.geometry import projective
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Poses
from camcal.registry import look_up
from camcal.settings.calibration import CalibrationOptions
from camcal.solve import starts
from camcal.solve.optimizers.base import Options as Stopping
from camcal.solve.parameters import apply_fixed
from camcal.solve.solution import CalibrationWarning, Stage
from camcal.solve.solve import residuals
from camcal.start import CLOSED_FORMS, shape
from camcal.start.base import ClosedForm


@dataclass(frozen=True)
class Options(CalibrationOptions):
    """The options of a calibration, and when its refinements stop."""

    stopping: Stopping = field(default_factory=Stopping)


def leave_out_unusable(correspondences: Correspondences) -> Correspondences:
    """The correspondences without views that no closed form can take; these become `rejected`.

    Raises
    ------
    DataError
        Where none is left, or all are exact copies of one.
    """
    count = len(correspondences.views)
    if count > 1 and shape.all_same(correspondences.views):
        raise DataError(
            f"all {count} views hold exactly the same points: they are one view; different ones are needed.",
            "Move and tilt the target between views. To calibrate from the one view, keep one copy of it.",
        )
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


def masked(correspondences: Correspondences, masks: Sequence[np.ndarray] | None) -> Correspondences:
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


def first_camera(
    lens: lenses.base.Lens, begun: Start, correspondences: Correspondences, told: Options
) -> tuple[Camera, dict[str, float | None]]:
    """The camera of the lens at hand that the refinement starts from, and all that it holds fixed."""
    fix = {**dict.fromkeys(lens.default_fixed), **begun.fix, **told.fix}
    params = lens.from_matrix(begun.matrix) if begun.camera is None else begun.camera.params
    return Camera(lens, apply_fixed(lens, params, fix), correspondences.image_size), fix
