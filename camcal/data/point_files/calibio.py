"""Detections in the JSON of calib.io's Calibrator: corners by camera, pose and target.

`detections[i] = {cameraId, poseId, targetId, featurePoints: [{point: {x, y}, id}]}`; the points of a target are
`calibration.targets[j].objectPoints`, `fileInfo[pose][camera].filePath` names the picture. A point without an id is the
one of its place in the list.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from camcal.data.formats.base import floats
from camcal.data.formats.calibio import listed_cameras, size_of
from camcal.data.formats.source import Source
from camcal.data.point_files.base import Array, Board, Reader, Size, one_camera, table_of
from camcal.data.table import Table
from camcal.errors import DataError


def _sniff(source: Source) -> bool:
    found = source.mapping.get("detections") if source.kind == "json" else None
    return isinstance(found, list) and any(isinstance(d, Mapping) and "featurePoints" in d for d in found)


def _read(source: Source, board: Board) -> tuple[Table, Size | None]:
    found = source.mapping
    inner = found.get("calibration", found.get("Calibration", found))
    targets = [_xyz(t["objectPoints"]) for t in inner["targets"]]
    cameras = listed_cameras(source) or []
    used = sorted({int(d["cameraId"]) for d in found["detections"] if d.get("featurePoints")})
    names = [f"camera{i}" for i in used]
    chosen = used[one_camera(source, names, board)] if used else 0
    views = []
    for entry in found["detections"]:
        if int(entry["cameraId"]) != chosen or not entry.get("featurePoints"):
            continue
        target, pose = int(entry.get("targetId", 0)), int(entry["poseId"])
        ids = _ids(source, entry["featurePoints"], targets[target])
        pixels = np.array([[f["point"]["x"], f["point"]["y"]] for f in entry["featurePoints"]], float)
        name = _name(found.get("fileInfo"), pose, chosen) + (f" board {target}" if len(targets) > 1 else "")
        views.append((name, targets[target][ids], pixels, ids))
    size = size_of(cameras[chosen]["model"]["ptr_wrapper"]["data"]) if chosen < len(cameras) else None
    return table_of(source, views), size


def _xyz(points: Any) -> Array:
    return floats([[p["x"], p["y"], p["z"]] for p in points], what="objectPoints").reshape(-1, 3)


def _ids(source: Source, features: Any, target: Array) -> Array:
    given = [f.get("id", f.get("featureId")) for f in features]
    if all(i is None for i in given):
        if len(given) != len(target):
            raise DataError(
                f"{source.path}: {len(given)} corners have no ids; the target has {len(target)}.",
                "Ids can be left out only where the whole board was detected.",
            )
        given = list(range(len(given)))
    ids = np.array([int(i) for i in given], int)
    if (ids < 0).any() or (ids >= len(target)).any():
        raise ValueError(f"corner {ids.max()} was found, on a target with {len(target)} points")
    return ids


def _name(files: Any, pose: int, camera: int) -> str:
    """The name of the picture without its folder; `pose3` if the file has none."""
    try:
        path = str(files[pose][camera]["filePath"])
    except (TypeError, KeyError, IndexError):
        path = ""
    return path.replace("\\", "/").rpartition("/")[2] or f"pose{pose}"


READER = Reader("detections of calib.io's Calibrator", _sniff, _read)
