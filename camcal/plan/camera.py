"""Attempts at a camera without a given start: closed forms, then the refinement, from other starts if it ends
badly.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from camcal import start
from camcal.assess import figures
from camcal.assess.warning import CalibrationWarning
from camcal.data.observations import Observations
from camcal.errors import CamcalError, EstimationError, caught
from camcal.geometry import projective
from camcal.model.camera import Camera
from camcal.model.lenses import make
from camcal.model.pose import Poses
from camcal.plan.better import Candidate, lowest
from camcal.plan.given_camera import GIVEN
from camcal.plan.progress import Attempt, Begin, Change, Progress
from camcal.plan.single_view import undetermined_centre
from camcal.registry import look_up
from camcal.solve import starts
from camcal.solve.calibration import Stage
from camcal.solve.parameters import apply_fixed
from camcal.solve.refine import refine, residuals
from camcal.solve.together import Task, refine_all
from camcal.start import radial, shape
from camcal.start.base import ClosedForm
from camcal.start.mirrored import mirrored_error


# ------------------------------------------------------------------------------------------------ closed forms
def closed_form(name: str) -> Attempt:
    """The attempt with a closed form of the table."""

    def applies(progress: Progress) -> bool:
        return progress.best is None and not progress.made("radial") and name in chosen(progress)[0]

    def make_(progress: Progress) -> Change:
        found, stage = run_closed_form(name, progress)
        return _from_closed_form(found, stage, progress)

    def together(members: Sequence[Progress]) -> list[Change | CamcalError]:
        options, begin = members[0].options, time.perf_counter()
        kept = [m.data.kept() for m in members]
        estimate_all = look_up(start.TOGETHER, name, "closed form")
        made = estimate_all(kept, options.skew, options.normalise)
        seconds = (time.perf_counter() - begin) / len(members)
        return [
            found if isinstance(found, CamcalError) else caught(_stage_and_begin, found, member, seconds)
            for found, member in zip(made, members, strict=True)
        ]

    return Attempt(name, applies, make_, together if name in start.TOGETHER else None)


def _stage_and_begin(found: ClosedForm, progress: Progress, seconds: float) -> Change:
    return _from_closed_form(found, _stage_of(found, progress, seconds), progress)


def _from_closed_form(found: ClosedForm, stage: Stage, progress: Progress) -> Change:
    if found.info.get("mirrored"):
        raise mirrored_error(found.poses[0].rotation)
    return Change(start=_begin(found, stage, progress), stage=stage)


def chosen(progress: Progress) -> tuple[list[str], str]:
    """The closed forms for the current rows, the starting one last, and the reason."""
    if progress.options.start_camera is not None:
        return [], "a camera was given"
    if progress.options.start is not None:
        return [progress.options.start], "as requested"
    return shape.choose(progress.data.kept())


def run_closed_form(name: str, progress: Progress) -> tuple[ClosedForm, Stage]:
    """Run a closed form on the used rows; return its entry for the report too."""
    kept, options = progress.data.kept(), progress.options
    begin = time.perf_counter()
    found = look_up(start.CLOSED_FORMS, name, "closed form")(kept, options.skew, options.normalise)
    return found, _stage_of(found, progress, time.perf_counter() - begin)


def _stage_of(found: ClosedForm, progress: Progress, seconds: float) -> Stage:
    """A closed form's entry for the report."""
    kept = progress.data.kept()
    if found.camera is not None:
        rms = figures.rms_point(residuals(found.camera, found.poses, kept))
    elif found.projection_matrix is not None:
        rms = figures.rms_point(projective.project(found.projection_matrix, kept.xyz) - kept.uv)
    else:
        rms = figures.rms_point(residuals(_pinhole(found.matrix, kept), found.poses, kept))
    failures = progress.notes.get("failures", {})
    info: dict[str, Any] = {"why": chosen(progress)[1], **found.info}
    if failures:
        info["failed_before"] = dict(failures)
    return Stage(
        found.name,
        rms,
        found.matrix,
        seconds,
        projection_matrix=found.projection_matrix,
        poses=found.poses,
        info=info,
    )


def _pinhole(matrix: np.ndarray, observations: Observations) -> Camera:
    lens = make("pinhole", skew=True)
    return Camera(lens, lens.from_matrix(matrix), observations.image_size)


def _begin(found: ClosedForm, stage: Stage, progress: Progress) -> Begin:
    """The camera of the current lens from a closed form's pinhole camera, and the assumptions made."""
    lens, options, kept = progress.lens, progress.options, progress.data.kept()
    held, warnings = _assumed(found, kept)
    how = options.how(lens, held)
    if lens.shaped_by_data or found.camera is not None:
        known = found.camera or _pinhole(found.matrix, kept)
        camera = starts.regressed(lens, known, kept, options.fix)
    else:
        camera = Camera(
            lens, apply_fixed(lens, lens.from_matrix(found.matrix), how.fix), progress.given.image_size
        )
    if not held:
        held, more = _held_centre(camera, found.poses, progress)
        warnings += more
    return Begin(found.name, camera, found.poses, stage.rms_point, held, warnings)


def _assumed(
    found: ClosedForm, observations: Observations
) -> tuple[Mapping[str, float | None], tuple[CalibrationWarning, ...]]:
    """Hold what a single view of a plane does not determine at the closed form's assumption, with a warning."""
    warnings = []
    if found.info.get("degenerate"):
        warnings.append(
            CalibrationWarning(
                "weak-geometry",
                f"these views barely determine the closed form: {found.info['degenerate']}.",
                "Add views of the target tilted by 20 to 45 degrees in different directions.",
            )
        )
    held: dict[str, float | None] = dict.fromkeys(found.info.get("held", ()))
    if not held or shape.distinct(observations.views) > 1:
        return {}, tuple(warnings)
    return held, (_single_view(found.info["assumptions"]), *warnings)


def _held_centre(
    camera: Camera, poses: Poses, progress: Progress
) -> tuple[Mapping[str, float | None], tuple[CalibrationWarning, ...]]:
    """Hold the principal point of the start where a single view of a plane leaves it undetermined, with a warning."""
    how = progress.options.how(progress.lens, {})
    names = undetermined_centre(camera, poses, progress.data.kept(), how.fix)
    if not names:
        return {}, ()
    return dict.fromkeys(("cx", "cy")), (_single_view(["the principal point is that of the initial camera"]),)


def _single_view(assumptions: Sequence[str]) -> CalibrationWarning:
    return CalibrationWarning(
        "single-view",
        f"one view of a plane does not determine the camera; assumed: {', '.join(assumptions)}.",
        "Add views of the target from other directions.",
    )


def _wants_radial(progress: Progress) -> bool:
    """Return whether there is no start, or one that took a wide lens for a pinhole, or the lens's shape comes from
    the data.
    """
    if progress.best is not None or progress.made("radial"):
        return False
    begun = progress.start
    return begun is None or progress.lens.shaped_by_data or starts.poor(begun.rms_point, progress.data)


def _radial(progress: Progress) -> Change | None:
    """Radial alignment; a closed form that is nearer remains the start."""
    kept = progress.data.kept()
    begin = time.perf_counter()
    rough = radial.estimate(kept)
    rms = float(np.sqrt(np.nanmean((residuals(rough.camera, rough.poses, kept) ** 2).sum(1))))
    stage = Stage(
        "radial",
        rms,
        rough.camera.matrix,
        time.perf_counter() - begin,
        camera=rough.camera,
        poses=rough.poses,
        info=rough.info,
    )
    if progress.start is not None and not rms < progress.start.rms_point:
        return None
    found = starts.from_radial(progress.lens, rough, kept, progress.options.fix)
    if not found:
        return None
    camera, poses = found[0]
    notes = {"other_starts": tuple(found[1:])}
    held, warnings = _held_centre(camera, poses, progress)
    return Change(start=Begin("radial", camera, poses, rms, held, warnings), stage=stage, notes=notes)


# -------------------------------------------------------------------------------------------------- refinements
def _refine(progress: Progress) -> Change:
    begun = progress.start
    assert begun is not None
    return Change(fit=Candidate(refine(begun.camera, begun.poses, progress.data, progress.how)))


def _refine_together(members: Sequence[Progress]) -> list[Change | CamcalError]:
    begun = [(m.start, m) for m in members if m.start is not None]
    made = refine_all([Task(b.camera, b.poses, m.data, m.how) for b, m in begun])
    return [f if isinstance(f, CamcalError) else Change(fit=Candidate(f)) for f in made]


def _doubtful(progress: Progress) -> bool:
    """Return whether the fit is missing or may be a wrong minimum; False while outliers are still to be found."""
    if progress.options.robust != "none" and not progress.restarts:
        return False
    return progress.start is not None and (progress.best is None or starts.doubtful(progress.fit))


def _wants_other_starts(progress: Progress) -> bool:
    """Return whether the fit is doubtful and radial alignment was not tried on the same rows."""
    return _doubtful(progress) and not progress.made("from-radial")


def _from_radial(progress: Progress) -> Change | None:
    """The refinement from radial alignment, if the one from the closed form ended badly."""
    kept, found = progress.data.kept(), []
    if progress.made("radial"):
        begins = list(progress.notes.get("other_starts", ()))
    else:
        begins = starts.from_radial(progress.lens, radial.estimate(kept), kept, progress.options.fix)
    for camera, poses in begins:
        try:
            found.append(refine(camera, poses, progress.data, progress.how))
        except EstimationError:
            continue  # another start may succeed
    return Change(fit=Candidate(lowest(found))) if found else None


def has_start_only(progress: Progress) -> bool:
    """Return whether there is a start from which nothing was refined yet."""
    return progress.best is None and progress.start is not None


def starts_from_nothing() -> tuple[Attempt, ...]:
    """The attempts at a start: a given camera, otherwise the closed forms of the table, and radial alignment."""
    closed_forms = (closed_form(name) for name in start.CLOSED_FORMS)
    return (GIVEN, *closed_forms, Attempt("radial", _wants_radial, _radial))


FROM_START: tuple[Attempt, ...] = (
    Attempt("least-squares", has_start_only, _refine, _refine_together),
    Attempt("from-radial", _wants_other_starts, _from_radial),
)
