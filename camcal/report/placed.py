"""Cameras with their poses in the world, from any file that holds them."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from camcal.data.dlt_table import looks_like_dlt, read_dlt
from camcal.data.formats import files
from camcal.data.formats.camcal import camera_of_entry as camera_of
from camcal.data.formats.checks import damage
from camcal.data.formats.source import Source
from camcal.errors import DataError
from camcal.model.pose import Pose
from camcal.report.yaml import read_document
from camcal.routes.placed import PlacedCamera
from camcal.system.documents import LARGEST
from camcal.system.reading import read_text


def load_placed(path: str | os.PathLike) -> tuple[PlacedCamera, ...]:
    """Cameras of a file of DLT coefficients, of a rig in any format, of a report with one view, or of `camcal pose`.

    Cameras of a DLT file are named 1, 2, ... in their order; one of a report without a name is named `camera`.

    Raises
    ------
    DataError
        If the file holds no camera with a pose.
    """
    source = Path(path)
    with damage(Source(source, b""), "cameras with poses"):
        return _load(source)


def _load(source: Path) -> tuple[PlacedCamera, ...]:
    if _is_dlt(source):
        return tuple(PlacedCamera.of_matrix(str(i + 1), m) for i, m in enumerate(read_dlt(source)))
    rig = _rig(source)
    if rig:
        return rig
    found = read_document(source)
    if "camera" in found:
        pose = _single_pose(found)
        if pose is not None:
            return (PlacedCamera(source.stem, camera_of(found["camera"]), pose),)
    raise DataError(
        f"'{source}' holds no camera with a pose.",
        "Give DLT coefficients (11 rows), a rig, the report of one view, or what `camcal pose` wrote.",
    )


def _rig(source: Path) -> tuple[PlacedCamera, ...]:
    """The cameras of a file of any format that holds the poses of several; none for other files."""
    known = files.read(source)
    if not known.has_poses or len(known.cameras) < 2:
        return ()
    return tuple(
        PlacedCamera(c.name, files.exact(c.camera), c.pose) for c in known.cameras if c.pose is not None
    )


def _is_dlt(source: Path) -> bool:
    if source.suffix.lower() in (".yaml", ".yml", ".json"):
        return False
    try:
        text = read_text(source, LARGEST)
    except DataError:
        return False
    if looks_like_dlt(text):
        return True
    # one with a row missing is refused as such, but not where the file holds another program's cameras
    return source.suffix.lower() in (".csv", ".txt") and not _is_camera_file(source)


def _is_camera_file(source: Path) -> bool:
    try:
        files.recognised(Source(source))
    except DataError:
        return False
    return True


def _single_pose(found: Mapping[str, Any]) -> Pose | None:
    if "solutions" in found:
        return Pose.from_entry(found["solutions"][0]["cam_from_world"])
    used = [v for v in found.get("views", []) if v.get("status") == "used"]
    return Pose.from_entry(used[0]["cam_from_board"]) if len(used) == 1 else None
