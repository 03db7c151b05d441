"""A solution as a plain document: `schema: camcal-report/1`. docs/report.md explains each key."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from camcal.assess import figures
from camcal.assess.covariance import Covariance
from camcal.assess.curvature import accuracy as accuracy_of
from camcal.assess.warning import CalibrationWarning, grade, warning_entry
from camcal.data.observations import Correspondences, SkippedView
from camcal.geometry import projective
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from camcal.plan.solution import RigSolution, Solution
from camcal.report.bias import section as bias
from camcal.report.camera import camera_entry
from camcal.report.coverage import section as coverage
from camcal.report.embedded import encode
from camcal.report.head import head
from camcal.report.plain import plain
from camcal.report.uncertainty import section as uncertainty
from camcal.report.yaml import save
from camcal.schema import Report, unknown_key
from camcal.solve.calibration import Estimate, Stage
from camcal.start.base import scaled

__all__ = ["document", "save"]

Array = np.ndarray


def document(
    solution: Solution,
    *,
    command: Sequence[str] = (),
    options: Mapping[str, Any] | None = None,
    warnings: Sequence[CalibrationWarning] = (),
    failures: Sequence[str] = (),
) -> dict[str, Any]:
    """Make the report of a solution, of plain Python types, in the order of the schema.

    Parameters
    ----------
    solution : Solution
    command : sequence of str
        The words after `camcal`, as typed.
    options : mapping, optional
        `{name: {value, from}}`; without it the solution's own options.
    warnings : sequence of CalibrationWarning
        In addition to those of the solution.
    failures : sequence of str
        Gates that failed in addition to those of the solution, each as a sentence.

    Returns
    -------
    dict
    """
    data = solution.observations
    accuracy = accuracy_of(solution)
    views, places = _views(solution, accuracy)
    subject: dict[str, Any] = {"camera": _camera(solution, accuracy)}
    if len(solution.poses) == 1:
        subject["projection_matrix"] = _projection_matrix(solution.camera, solution.poses[0])
    return assembled(
        solution,
        accuracy,
        command=command,
        options=options,
        inputs=_inputs(data),
        subject=subject,
        views=views,
        data=encode(data, places),
        uncertainty=uncertainty(solution, accuracy),
        # tests of the residuals are checks, and the slowest part of a report
        bias=None if solution.option("checks") is False else bias(solution, accuracy),
        coverage=coverage(solution),
        warnings=warnings,
        failures=failures,
    )


def assembled(
    solution: Solution | RigSolution,
    accuracy: Covariance,
    *,
    command: Sequence[str],
    options: Mapping[str, Any] | None,
    inputs: dict[str, Any],
    subject: dict[str, Any],
    views: list[dict[str, Any]],
    data: dict[str, Any] | None,
    uncertainty: dict[str, Any] | None = None,
    bias: dict[str, Any] | None = None,
    coverage: dict[str, Any] | None = None,
    warnings: Sequence[CalibrationWarning] = (),
    failures: Sequence[str] = (),
) -> dict[str, Any]:
    """The report of a camera or a rig: the common sections, in the schema's order, combined with its own.

    Raises
    ------
    TypeError
        If a key is not in the schema, since docs/report.md would not explain it.
    """
    fallen, said = [*solution.failures, *failures], (*solution.warnings, *warnings)
    made: dict[str, Any] = {
        **head(command),
        "inputs": inputs,
        "options": dict(solution.options) if options is None else options,
        "target": solution.observations.target,
        "stages": [stage_entry(s) for s in solution.stages],
        **subject,
        **({} if solution.selection is None else {"selection": solution.selection}),
        "views": views,
        "fit": fit_entry(solution, accuracy),
        "uncertainty": uncertainty,
        "holdout": solution.holdout,
        "bias": bias,
        "coverage": coverage,
        "crosscheck": list(solution.crosscheck),
        "warnings": [warning_entry(w) for w in said],
        "verdict": "fail" if fallen else "pass",
        "grade": grade(said),
        "failures": fallen,
        "data": data,
    }
    return checked(plain(made))


def compact_document(solution: Solution, command: Sequence[str] = ()) -> dict[str, Any]:
    """The camera, its error figures and the verdict alone: a camera file rather than a full report."""
    accuracy = accuracy_of(solution)
    data = solution.observations
    inputs = {**_inputs(data), "views": len(solution.poses)}
    made = {
        **head(command),
        "inputs": inputs,
        "options": dict(solution.options),
        "camera": _camera(solution, accuracy),
        "fit": fit_entry(solution, accuracy),
        "holdout": solution.holdout,
        "warnings": [warning_entry(w) for w in solution.warnings],
        "verdict": solution.verdict,
        "failures": solution.failures,
    }
    return plain(made)


def checked(made: dict[str, Any]) -> dict[str, Any]:
    """Raise an error for a key that the schema does not have, since docs/report.md would not explain it."""
    unknown = unknown_key(Report, made)
    if unknown is not None:
        raise TypeError(f"the schema of the report has no key '{unknown}'")
    return made


def _inputs(data: Correspondences) -> dict[str, Any]:
    return {
        "image_size": data.image_size,
        "views": len(data.views) + len(data.skipped),
        "points": data.point_count,
        "files": list(data.files),
    }


def stage_entry(stage: Stage) -> dict[str, Any]:
    """Describe a stage of the calibration for the report, without missing values."""
    entry: dict[str, Any] = {
        "name": stage.name,
        "rms_point": stage.rms_point,
        "seconds": stage.seconds,
        "matrix": stage.matrix,
    }
    if stage.camera is not None:
        entry["parameters"] = stage.camera.values
    if stage.projection_matrix is not None:
        entry["projection_matrix"] = scaled(stage.projection_matrix)
    if stage.info:
        entry["info"] = stage.info
    return entry


def _camera(solution: Solution, accuracy: Covariance) -> dict[str, Any]:
    entry = camera_of_fit(solution.camera, accuracy.sigmas, solution.start, solution.free)
    entry["correlations"] = [{"pair": [a, b], "value": r} for a, b, r in accuracy.strong_correlations()]
    return entry


def camera_of_fit(camera: Camera, sigmas: Mapping[str, float], start: Camera, free: Array) -> dict[str, Any]:
    """The entry of an estimated camera; its rows (P, F) of d params / d variables."""
    free = free[:, free.any(0)]  # columns of zeros belong to the board's shape, which `target` holds
    fixed = ~np.any(free, axis=1)
    held = [name for name, is_fixed in zip(camera.lens.names, fixed, strict=True) if is_fixed]
    entry = camera_entry(camera, sigmas, start.values, held)
    if not _is_selection(free):
        entry["free_directions"] = free
    return entry


def _is_selection(free: Array) -> bool:
    """Return whether the free parameters are exactly the unfixed ones, without ties."""
    return np.array_equal(free, np.eye(len(free))[:, free.any(1)])


def _projection_matrix(camera: Camera, pose: Pose) -> Array:
    return scaled(projective.compose(camera.matrix, pose.rotation, pose.translation))


def _views(solution: Solution, accuracy: Covariance) -> tuple[list[dict[str, Any]], list[int]]:
    """The entries of all views in input order, and the indices of the used ones among them."""
    data = solution.observations
    sigmas = np.sqrt(np.diagonal(accuracy.poses(), axis1=1, axis2=2))
    entries = [
        used_view(solution, i, view.id, solution.poses[i], sigmas[i]) for i, view in enumerate(data.views)
    ]
    used = [e["id"] for e in entries]
    entries += [skipped_entry(s) for s in data.skipped]
    order = _input_order([e["id"] for e in entries], data)
    entries = [entries[i] for i in order]
    places = [i for i, e in enumerate(entries) if e["status"] == "used"]
    assert [entries[i]["id"] for i in places] == used  # `_input_order` keeps their order
    quality = data.picture_quality
    for entry in entries:
        if entry["id"] in quality:
            entry["quality"] = quality[entry["id"]]
    return entries, places


def _input_order(ids: list[str], data: Correspondences) -> list[int]:
    """The order of the list of files if it names every view; otherwise used views, then the rest."""
    paths = [str(f["path"]).replace("\\", "/") for f in data.files]
    by_path = {p: i for i, p in reversed(list(enumerate(paths)))}
    by_name = {p.rpartition("/")[2]: i for i, p in reversed(list(enumerate(paths)))}
    known = [by_path.get(v, by_name.get(v)) for v in ids]
    plain_order = list(range(len(ids)))
    if any(k is None for k in known) or len(set(known)) < len(known):
        return plain_order
    order = sorted(plain_order, key=lambda i: known[i] or 0)
    kept = [i for i in order if i < len(data.views)]
    return order if kept == sorted(kept) else plain_order


def used_view(solution: Estimate, index: int, name: str, pose: Pose, sigmas: Array | None) -> dict[str, Any]:
    """The entry of a block's picture, with its pose cam_from_board and that pose's sigmas (6,)."""
    view = solution.observations.views[index]
    rows = solution.observations.slices[index]
    residuals, inliers = solution.residuals[rows], solution.used[rows]
    entry: dict[str, Any] = {
        "id": name,
        "status": "used",
        "reason": None,
        "points": len(view),
        "rejected_points": int((~inliers).sum()),
        "rms_point": figures.rms_point(residuals[inliers]),
        "cam_from_board": pose.entry(),
    }
    if sigmas is not None:
        entry["cam_from_board"]["sigma"] = {"rotation": sigmas[:3], "centroid": sigmas[3:]}
    if not inliers.all():
        entry["rejected"] = [
            {
                "row": int(row),
                "id": None if view.point_ids is None else int(view.point_ids[row]),
                "u": float(view.uv[row, 0]),
                "v": float(view.uv[row, 1]),
                "residual": residuals[row],
            }
            for row in np.flatnonzero(~inliers)
        ]
    return entry


def skipped_entry(view: SkippedView) -> dict[str, Any]:
    """Describe a skipped view for the report, with its status and reason."""
    return {
        "id": view.id,
        "status": view.status,
        "reason": view.reason,
        "points": view.points,
        "rejected_points": view.points,
        "rms_point": view.rms_point,
        "cam_from_board": None,
    }


def fit_entry(solution: Estimate, accuracy: Covariance) -> dict[str, Any]:
    """Describe the fit for the report: the optimizer, its result and the error figures."""
    fit, all_points = solution.fit, figures.overall(solution)
    used = all_points.points
    return {
        "optimizer": fit.optimizer,
        "loss": fit.loss,
        "iterations": fit.iterations,
        "evaluations": fit.evaluations,
        "converged": fit.converged,
        "stop_reason": fit.stop_reason,
        "cost": fit.cost,
        "seconds": fit.seconds,
        "rms_point": all_points.rms_point,
        "rms_coord": all_points.rms_coord,
        "sigma_hat": figures.sigma_hat(solution),
        "sigma_0": figures.sigma_0(solution),
        "median": all_points.median,
        "p95": all_points.p95,
        "max": all_points.max,
        "points_used": used,
        "points_rejected": solution.observations.point_count - used,
        "free_parameters": solution.free_count,
        "condition": accuracy.condition,
        "info": fit.info,
    }
