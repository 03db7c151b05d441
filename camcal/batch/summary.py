"""The row of a job in the summary, from its report."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from camcal.batch.rows import Row

if TYPE_CHECKING:
    from camcal.model.camera import Camera
    from camcal.plan.solution import Solution

DONE, FAILED = "done", "failed"


def distortion_px(camera: Camera) -> float:
    """The mean radial distortion at half the picture's height from the principal point, px.

    Of the projections of eight rays that a camera without distortion would see there: one figure for any lens
    model. NaN where the size of the picture is not known or the lens does not see so far.
    """
    if camera.image_size is None:
        return float("nan")
    angle = np.arange(8) * np.pi / 4
    k = camera.matrix
    offset = 0.5 * camera.image_size[1] * np.c_[np.cos(angle), np.sin(angle)]
    rays = np.c_[offset, np.zeros(8)] @ np.linalg.inv(k).T + [0.0, 0.0, 1.0]
    moved = camera.project(rays) - k[:2, 2]
    radius = np.linalg.norm(moved, axis=1) - 0.5 * camera.image_size[1]
    return float(radius.mean()) if np.isfinite(radius).all() else float("nan")


def summary_row(report: dict[str, Any]) -> Row:
    """The summary row of a finished job, from its report."""
    fit, rig = report["fit"], report.get("rig")
    cameras = report["cameras"] if rig else {"": report["camera"]}
    row: Row = {
        "status": DONE,
        "reason": " ".join(report["failures"]),
        "rms_point": fit["rms_point"],
        "verdict": report["verdict"],
        "grade": report.get("grade") or _grade(report),
        "warnings": ",".join(w["code"] for w in report["warnings"]),
        "model": "+".join(dict.fromkeys(c["model"] for c in cameras.values())),
        "image_size": "+".join(
            dict.fromkeys("x".join(map(str, c["image_size"] or ())) for c in cameras.values())
        ),
        "views": report["inputs"]["views"] if "views" not in report else _used(report),
        "points": fit["points_used"],
        "holdout": (report["holdout"] or {}).get("rms_point"),
    }
    if not rig:
        return row | _of_camera(report["camera"])
    # the cameras of a rig and their distances are compared with those of other rigs
    row["parts"] = {name: _of_camera(camera) for name, camera in cameras.items()}
    row["baselines"] = rig["baselines"]
    return row


def _of_camera(camera: dict[str, Any]) -> Row:
    from camcal.data.formats.camcal import camera_of_entry

    values = {name: entry["value"] for name, entry in camera["parameters"].items()}
    sigmas = {name: entry["sigma"] or 0.0 for name, entry in camera["parameters"].items()}
    bent = distortion_px(camera_of_entry(camera))
    row: Row = {"distortion": bent if np.isfinite(bent) else None}
    row["focal"] = 0.5 * (values["fx"] + values["fy"])
    # fx and fy are strongly correlated: the sigma of their mean is taken as the mean of their sigmas
    row["sigma_focal"] = 0.5 * (sigmas["fx"] + sigmas["fy"])
    for name in ("cx", "cy"):
        row[name], row[f"sigma_{name}"] = values[name], sigmas[name]
    return row


def for_prior(report: dict[str, Any], solution: Solution) -> Row:
    """The input of `prior.py`: the camera, its free parameters, and their covariance."""
    from camcal.assess.covariance import covariance

    accuracy = covariance(solution)
    free = [name for name, entry in report["camera"]["parameters"].items() if not entry["fixed"]]
    places = [accuracy.names.index(name) for name in free]
    matrix = accuracy.matrix[np.ix_(places, places)]
    return {"camera": report["camera"], "free": free, "covariance": matrix.tolist()}


def _used(report: dict[str, Any]) -> int:
    return sum(view["status"] == "used" for view in report["views"])


def _grade(report: dict[str, Any]) -> str:
    severities = {w.get("severity") for w in report["warnings"]}
    return next((grade for grade in ("wrong", "doubtful") if grade in severities), "good")
