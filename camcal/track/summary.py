"""The summary of a run as plain data for the report."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from camcal.track.estimator import Estimator
from camcal.track.follow import Summary
from camcal.track.table import COVARIANCE, MATRIX, PARAMETERS, Table


def document(summary: Summary, estimator: Estimator, method: str) -> dict[str, Any]:
    """The entries `camera`, `projection_matrix`, `pose` and `track` of a report.

    `camera` and `projection_matrix` are those of the last frame with an estimate; null without one.
    """
    track = {
        "method": method,
        "gain": estimator.options.gain or (estimator.gains[0] if estimator.gains else None),
        "frames": summary.frames,
        "statuses": dict(summary.statuses),
        "points": summary.points,
        "points_used": summary.used,
        "frames_ignored": summary.ignored,
        "noise": None if summary.last is None else summary.last.noise,
        "effective": None if summary.last is None else summary.last.effective,
        "nis_per_degree_of_freedom": summary.nis / summary.nis_dof if summary.nis_dof else None,
        "false_alarm_rate": estimator.options.false_alarm,
        "change_count": summary.change_count,
        "changes": [
            {"frame": c.frame, "since": c.since, "kind": c.kind, "message": c.message, **c.figures}
            for c in summary.changes
        ],
    }
    return {**_camera(summary, estimator), "track": track}


def _camera(summary: Summary, estimator: Estimator) -> dict[str, Any]:
    if summary.last is None:
        return {"camera": None, "projection_matrix": None, "pose": None}
    model = estimator.model
    table = Table(model)
    values = dict(zip(_names(table), table.values([summary.last])[0].tolist(), strict=True))
    assert summary.last.factor is not None
    cameras = model.describe([summary.last.estimate], [summary.last.factor])
    lens_names = ("fx", "fy", "cx", "cy", *["skew"] * model.has_skew, *model.extra_names)
    camera = {
        "model": model.lens_name,
        "image_size": None,
        "pixel_center": "integer",
        "matrix": cameras.k[0],
        "parameters": {n: _entry(values, n) for n in lens_names},
    }
    pose = {
        "rotation_vector": [values[n] for n in ("rx", "ry", "rz")],
        "translation": [values[n] for n in ("tx", "ty", "tz")],
        "sigma_rotation_vector": [values[f"sigma_{n}"] for n in ("rx", "ry", "rz")],
        "sigma_translation": [values[f"sigma_{n}"] for n in ("tx", "ty", "tz")],
    }
    factor = cameras.factor[0]
    return {
        "camera": camera,
        "projection_matrix": np.reshape([values[n] for n in MATRIX], (3, 4)),
        "pose": pose,
        "covariance": {"order": [*COVARIANCE, *model.extra_names], "matrix": factor @ factor.T},
    }


def _entry(values: Mapping[str, float], name: str) -> dict[str, Any]:
    sigma = values[f"sigma_{name}"]
    return {"value": values[name], "sigma": sigma or None, "start": values[name], "fixed": not sigma}


def _names(table: Table) -> list[str]:
    estimates = [*MATRIX, *PARAMETERS, *table.extra]
    return estimates + [f"sigma_{n}" for n in estimates]
