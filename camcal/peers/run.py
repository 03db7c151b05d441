"""Every stage of a calibration against its counterpart in cv2."""

from __future__ import annotations

from camcal.peers import (
    calibrate_camera_ro,
    closed_form,
    find_homography,
    project_points,
    refinement,
    rodrigues,
)
from camcal.peers.base import Entry, Rerun, one_thread
from camcal.solve.solution import Solution, Stage


def crosscheck(solution: Solution, rerun: Rerun | None = None) -> tuple[Entry, ...]:
    """Compare each stage of a solution with cv2.

    Parameters
    ----------
    solution : Solution
        With its `stages`; those named `refine` stand for the solution itself.
    rerun : callable, optional
        `rerun(correspondences, skew[, board_shape]) -> Solution` calibrates again by the same options with a
        linear loss and, where nothing else is said, a flat board; called where cv2 lacks a part of the problem
        (skew, weights, points that are not in all views), so that the rest can be compared.

    Returns
    -------
    tuple of dict
        Entries of the report: {stage, against, status, why, opencv, difference}; `status` is pass, fail or
        not_applicable, and the latter two always have a `why`. Differences are camcal's less cv2's.
    """
    entries: list[Entry] = []
    with one_thread():
        for stage in solution.stages:
            if stage.name != refinement.STAGE:
                entries += _closed_form(stage, solution)
        entries += refinement.against_cv2(solution, rerun)
        shaped = calibrate_camera_ro.against_cv2(solution, rerun)
        entries += [shaped] if shaped else []
        projected = project_points.of_solution(solution)
        entries += [projected] if projected else []
        entries.append(rodrigues.against_cv2(solution.poses, refinement.STAGE))
    return tuple(entries)


def _closed_form(stage: Stage, solution: Solution) -> list[Entry]:
    views = solution.correspondences.views
    if stage.projection_matrix is not None and len(views) == 1:
        found: list[Entry | None] = [project_points.of_matrix(stage.name, stage.projection_matrix, views[0])]
        if stage.name == "zhang":
            found.append(find_homography.against_cv2(views, stage.name))
    else:
        found = [closed_form.against_cv2(stage, solution), find_homography.against_cv2(views, stage.name)]
    return [e for e in found if e is not None]
