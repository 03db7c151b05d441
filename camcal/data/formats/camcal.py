"""camcal's own reports, and the true values written with simulated data: `camera`, or `cameras` and `rig`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from camcal.data.formats.base import CameraFile, Format, NamedCamera
from camcal.data.formats.source import Source
from camcal.errors import DataError
from camcal.model.camera import Camera
from camcal.model.lenses import make
from camcal.model.pose import Pose
from camcal.schema import check, structure
from camcal.schema.camera import Camera as Section
from camcal.schema.camera import Rig, RigPose

TRUTH = "camcal-truth/1"


def _sniff(source: Source) -> bool:
    return source.kind in ("yaml", "json") and "schema" in source.mapping


def _read(source: Source) -> CameraFile:
    found, name = source.mapping, str(source.path)
    if found["schema"] != TRUTH:
        check(found, name)
    if "cameras" not in found:
        if found.get("camera") is None:
            raise DataError(f"'{name}' is damaged: 'camera' is missing.", "Create the report again.")
        return CameraFile.one(camera_of_entry(found["camera"], name))
    entries = structure(dict[str, Section], found["cameras"], name, "cameras")
    rig = structure(Rig, found["rig"], name, "rig") if "rig" in found else None
    poses = _poses(rig, list(entries))
    return CameraFile(
        tuple(NamedCamera(n, _camera(e, name, f"cameras.{n}"), poses.get(n)) for n, e in entries.items()),
        reference=None if rig is None else rig.reference,
    )


def camera_of_entry(entry: Mapping[str, Any], source: str = "report", path: str = "camera") -> Camera:
    """Return the camera of an entry `camera` of a report.

    Raises
    ------
    DataError
        With the path to a value that does not fit.
    """
    return _camera(structure(Section, entry, source, path), source, path)


def _camera(section: Section, source: str, path: str) -> Camera:
    given = section.parameters
    lens = make(section.model, skew="skew" in given)
    missing = [name for name in lens.names if name not in given]
    if missing:
        raise DataError(
            f"'{source}' is damaged: '{path}.parameters.{missing[0]}' is missing.", "Create the report again."
        )
    params = np.array([given[name].value for name in lens.names], float)
    return Camera(lens, params, section.image_size)


def pose_of_entry(entry: Mapping[str, Any] | RigPose) -> Pose:
    """The pose of an entry with rotation_vector and translation."""
    section = entry if isinstance(entry, RigPose) else structure(RigPose, entry, "report", "pose")
    return Pose.from_vector(np.array(section.rotation_vector), np.array(section.translation))


def _poses(rig: Rig | None, names: list[str]) -> dict[str, Pose]:
    """cam_from_world of each camera, from cam_from_rig and, if the file has it, rig_from_world."""
    if rig is None:
        return {}
    found = {n: pose_of_entry(p) for n, p in rig.cam_from_rig.items()}
    found.setdefault(rig.reference, Pose.identity())
    if isinstance(rig.rig_from_world, RigPose):
        world = pose_of_entry(rig.rig_from_world)
        found = {n: p @ world for n, p in found.items()}
    return {n: p for n, p in found.items() if n in names}


def rig_entry(cameras: CameraFile) -> dict[str, Any] | None:
    """The entry `rig` of several cameras with poses; None if one has no pose.

    The reference is the first camera. `rig_from_world` is there where the file's common frame is another one.
    """
    if not cameras.has_poses:
        return None
    first, *rest = cameras.cameras
    assert first.pose is not None
    back = first.pose.inverse()
    others = {c.name: (c.pose @ back).entry() for c in rest if c.pose is not None}
    made: dict[str, Any] = {"reference": first.name, "cam_from_rig": others}
    if not (np.array_equal(first.pose.rotation, np.eye(3)) and not first.pose.translation.any()):
        made["rig_from_world"] = first.pose.entry()
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
