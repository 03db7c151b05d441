"""camcal's own reports, and the truth beside simulated data: `camera`, or `cameras` and `rig`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from camcal.data.formats.base import Array, CameraFile, Format, NamedCamera
from camcal.data.formats.source import Source
from camcal.errors import DataError
from camcal.geometry import rotations
from camcal.model.camera import Camera
from camcal.model.lenses import make
from camcal.model.pose import Pose

NAME, VERSION = "camcal-report", 1
TRUTH = "camcal-truth/1"


def _sniff(source: Source) -> bool:
    return source.kind in ("yaml", "json") and "schema" in source.mapping


def _read(source: Source) -> CameraFile:
    found = source.mapping
    name, _, version = str(found["schema"]).partition("/")
    if found["schema"] != TRUTH:
        if name != NAME:
            raise DataError(
                f"'{source.path}' is not a camcal report: it has no 'schema: {NAME}/{VERSION}'.",
                "A report is what `camcal estimate -o report.yaml` writes.",
            )
        if not version.isdigit() or int(version) > VERSION:
            raise DataError(
                f"'{source.path}' has schema {found['schema']}; this camcal reads {NAME}/{VERSION}.",
                "A newer camcal made it: upgrade.",
            )
    if "cameras" not in found:
        return CameraFile.one(camera_of_entry(found["camera"]))
    poses = _poses(found.get("rig"), list(found["cameras"]))
    return CameraFile(
        tuple(NamedCamera(n, camera_of_entry(e), poses.get(n)) for n, e in found["cameras"].items())
    )


def camera_of_entry(entry: Mapping[str, Any]) -> Camera:
    """The camera of the entry `camera` of a report."""
    given = entry["parameters"]
    lens = make(entry["model"], skew="skew" in given)
    params = np.array([given[name]["value"] for name in lens.names], float)
    size = entry["image_size"]
    return Camera(lens, params, None if not size else (int(size[0]), int(size[1])))


def pose_of_entry(entry: Mapping[str, Any]) -> Pose:
    """The pose of an entry with rotation_vector and translation."""
    vector = np.array(entry["rotation_vector"], float).reshape(3)
    return Pose(rotations.exp(vector), np.array(entry["translation"], float).reshape(3))


def _poses(rig: Mapping[str, Any] | None, names: list[str]) -> dict[str, Pose]:
    """cam_from_world of each camera: of its pose from the rig and, where the file says it, the rig's from the world."""
    if rig is None:
        return {}
    found = {n: pose_of_entry(p) for n, p in rig["cam_from_rig"].items()}
    found.setdefault(str(rig["reference"]), Pose.identity())
    if "rig_from_world" in rig:
        world = pose_of_entry(rig["rig_from_world"])
        found = {n: p @ world for n, p in found.items()}
    return {n: p for n, p in found.items() if n in names}


def pose_entry(pose: Pose) -> dict[str, Array]:
    """The entry of a pose: rotation_vector (rad) and translation."""
    return {"rotation_vector": rotations.log(pose.rotation), "translation": pose.translation}


def rig_entry(cameras: CameraFile) -> dict[str, Any] | None:
    """The entry `rig` of several cameras with poses; None where one has no pose.

    The reference is the first camera. `rig_from_world` is there where the file's common frame is another one.
    """
    if not cameras.has_poses:
        return None
    first, *rest = cameras.cameras
    assert first.pose is not None
    back = first.pose.inverse()
    others = {c.name: pose_entry(c.pose @ back) for c in rest if c.pose is not None}
    made: dict[str, Any] = {"reference": first.name, "cam_from_rig": others}
    if not (np.array_equal(first.pose.rotation, np.eye(3)) and not first.pose.translation.any()):
        made["rig_from_world"] = pose_entry(first.pose)
    return made


FORMAT = Format(
    "camcal",
    "a camcal report",
    (".yaml", ".json"),
    _sniff,
    _read,
    None,
    models=(),
    several=True,
    poses=True,
    order="by name; px; rotation vectors, cam_from_rig",
    source="docs/report.md",
)
