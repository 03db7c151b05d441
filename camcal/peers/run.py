"""Every stage of a calibration compared with its counterpart in cv2."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from camcal.peers import (
    calibrate_camera_ro,
    closed_form,
    find_homography,
    project_points,
    refinement,
    rodrigues,
)
from camcal.peers.base import Entry
from camcal.solve.calibration import Calibration, Stage
from camcal.solve.refine import How
from camcal.start import CLOSED_FORMS
from camcal.system.processes import one_opencv_thread


def crosscheck(
    solution: Calibration,
    stages: Sequence[Stage] = (),
    how: How | None = None,
    on_the_way: Mapping[str, Calibration] | None = None,
    full: bool = True,
) -> tuple[Entry, ...]:
    """Compare each stage of a solution with cv2.

    Parameters
    ----------
    solution : Calibration
    stages : sequence of Stage
        The way to it; closed forms are compared.
    how : How, optional
        How the solution was made: where cv2 lacks a part of the problem (skew, weights, points that are not in all
        views), the rest is fitted again, so that it can be compared.

    on_the_way : mapping of stage name -> Calibration, optional
        Fits before the result that cv2 calibrates, too: the flat board of a result with another shape.
    full : bool
        Whether cv2 calibrates by itself, closed forms and the nearest of its models included; else it begins at each
        optimum, to see that it stays there.

    Returns
    -------
    tuple of dict
        Entries of the report: {stage, against, status, why, opencv, difference}; `status` is pass, fail or
        not_applicable, and the latter two always have a `why`. Differences are camcal's less cv2's.
    """
    entries: list[Entry] = []
    with one_opencv_thread():
        for stage in stages:
            if stage.name in CLOSED_FORMS or stage.name == "radial":
                entries += _closed_form(stage, solution, full)
        for name, fit in (on_the_way or {}).items():
            entries += [e | {"stage": name} for e in refinement.against_cv2(fit, how, full)]
        entries += refinement.against_cv2(solution, how, full)
        shaped = calibrate_camera_ro.against_cv2(solution, how, full)
        entries += [shaped] if shaped else []
        projected = project_points.of_solution(solution)
        entries += [projected] if projected else []
        entries.append(rodrigues.against_cv2(solution.poses, refinement.STAGE))
    return tuple(entries)


def _closed_form(stage: Stage, solution: Calibration, full: bool) -> list[Entry]:
    views = solution.observations.views
    if stage.projection_matrix is not None and len(views) == 1:
        found: list[Entry | None] = [project_points.of_matrix(stage.name, stage.projection_matrix, views[0])]
        if stage.name == "zhang":
            found.append(find_homography.against_cv2(views, stage.name))
    else:
        found = [closed_form.against_cv2(stage, solution)] if full else []
        found.append(find_homography.against_cv2(views, stage.name))
    return [e for e in found if e is not None]
