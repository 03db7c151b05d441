"""A prior from cameras of the same type, for cameras that few views leave uncertain.

The parameters p of a camera are the fleet's mean μ, the camera's own deviation of covariance T, and the error of its
calibration of covariance C. With the mean and the covariance S of all p of a type,

    T = S - mean C,  negative eigenvalues set to zero                                                      (1)
    p' = p + C (C + T + cov μ)⁻¹ (μ - p),     C' = C - C (C + T + cov μ)⁻¹ C                                (2)

(1) is the method of moments, (2) the best linear estimate: empirical Bayes (Efron & Morris, JASA 70, 1975). A camera
that is known well stays where it is; along a direction that its views leave undetermined it becomes like the others.
Outliers of the control charts neither make the prior nor follow it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from camcal.batch.fleet import LEAST, type_of
from camcal.batch.rows import Row
from camcal.batch.storage import Storage
from camcal.batch.summary import DONE
from camcal.data.formats.camcal import camera_of_entry
from camcal.report.camera import camera_document, camera_entry
from camcal.report.plain import plain
from camcal.report.yaml import dump_yaml

Array = np.ndarray

FOLDER = "fleet"


def regularised(values: Array, covariances: Array) -> tuple[Array, Array, Array]:
    """Equation (2) for all cameras of a type.

    Parameters
    ----------
    values : (N, F) array
        Free parameters of each camera.
    covariances : (N, F, F) array
        Of their errors.

    Returns
    -------
    values : (N, F) array
    covariances : (N, F, F) array
    between : (F, F) array
        T of equation (1).
    """
    count = len(values)
    mean, error = values.mean(0), covariances.mean(0)
    # parameters have different units: eigenvalues are taken in units of the mean errors
    unit = np.sqrt(np.diag(error))
    spread = np.cov(values.T).reshape(error.shape) - error
    size, directions = np.linalg.eigh(spread / unit / unit[:, None])
    between = (directions * np.maximum(size, 0.0)) @ directions.T * unit * unit[:, None]
    total = between + (between + error) / count
    gain = np.linalg.solve(
        (covariances + total).transpose(0, 2, 1), covariances.transpose(0, 2, 1)
    ).transpose(0, 2, 1)
    moved = values + np.einsum("nij,nj->ni", gain, mean - values)
    return moved, covariances - gain @ covariances, between


def write_fleet(rows: Sequence[Row], storage: Storage) -> int:
    """Write OUT/fleet/NAME.yaml, the regularised camera, for each camera of a sufficiently large type.

    Returns
    -------
    int
        Cameras written.
    """
    groups: dict[tuple[Any, ...], list[int]] = {}
    for index, row in enumerate(rows):
        if row["status"] == DONE and "covariance" in row and not row["outlier"]:
            # only what is free in all of them can be compared
            groups.setdefault((type_of(row), row["camera"]["model"], *row["free"]), []).append(index)
    written = 0
    for (_, _, *names), group in groups.items():
        if len(group) < LEAST or not names:
            continue
        if not written:
            storage.make(FOLDER)
        values = np.array([[rows[i]["camera"]["parameters"][n]["value"] for n in names] for i in group])
        covariances = np.array([rows[i]["covariance"] for i in group])
        if not np.isfinite(covariances).all() or len(group) <= len(names):
            continue
        moved, left, between = regularised(values, covariances)
        for i, new, covariance in zip(group, moved, left, strict=True):
            row = rows[i]
            document = _document(
                row, names, new, np.sqrt(np.diag(covariance)), np.sqrt(np.diag(between)), len(group)
            )
            storage.write(f"{FOLDER}/{row['name']}.yaml", dump_yaml(document))
            written += 1
    return written


def _document(
    row: Row, names: list[str], new: Array, sigmas: Array, between: Array, count: int
) -> dict[str, Any]:
    camera = camera_of_entry(row["camera"])
    values = {**camera.values, **dict(zip(names, new.tolist(), strict=True))}
    camera = replace(camera, params=np.array([values[n] for n in camera.lens.names]))
    held = [n for n in camera.lens.names if n not in names]
    start = {n: e["value"] for n, e in row["camera"]["parameters"].items()}
    entry = camera_entry(camera, dict(zip(names, sigmas.tolist(), strict=True)), start, held)
    prior = {
        "cameras": count,
        "between": {name: float(s) for name, s in zip(names, between, strict=True)},
    }
    return plain(camera_document(camera, ["batch", row["name"]]) | {"camera": entry, "fleet_prior": prior})
