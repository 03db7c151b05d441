"""The public functions for camera files: `camcal.load` and `camcal.save_camera`."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from camcal.data.formats import files, format_of
from camcal.data.formats.base import CameraFile, NamedCamera
from camcal.data.formats.camcal import FORMAT as REPORT
from camcal.data.formats.source import Source
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from camcal.model.rig import Rig
from camcal.plan.solution import Solution
from camcal.report.camera import cameras_document
from camcal.report.document import save
from camcal.report.hand_eye import HandEye, load_hand_eye
from camcal.report.loading import from_document, load_camera
from camcal.report.yaml import read_document


def load(path: str | os.PathLike) -> Solution | HandEye | Camera | Rig:
    """Read a calibration, a camera or a rig from a file of any format.

    Parameters
    ----------
    path : path
        A report of camcal, or a camera file of any program (docs/formats.md); `FILE#NAME` is one camera of
        several.

    Returns
    -------
    Solution of a report with its data, HandEye of one of `camcal hand-eye`; Rig of the report of a rig, or of a file of
    several cameras with their poses; else Camera.

    Raises
    ------
    DataError
        If the file is missing, damaged, or of no known format, or holds several cameras without poses.
    """
    file = Path(path)
    if file.is_file():
        source = Source(file)
        if REPORT.sniff(source) and "data" in source.mapping:
            if "hand_eye" in source.mapping:
                return load_hand_eye(file)
            if "cameras" not in source.mapping:
                return from_document(read_document(file), str(file))
    found = files.read(path)
    if len(found.cameras) > 1 and found.has_poses:
        return load_rig_cameras(path)
    return load_camera(path)


def is_rig(path: str | os.PathLike) -> bool:
    """Return whether a file holds a rig: several cameras with poses that are not pictures of one camera, as in
    Pix4D's.
    """
    found = files.read(path)
    if len(found.cameras) == 1 or not found.has_poses:
        return False
    return not found.of_pictures or len({_key(c.camera) for c in found.cameras}) > 1


def _key(camera: Any) -> tuple[Any, ...]:
    """The common features of two entries that are the same camera."""
    return camera.lens.name, camera.lens.has_skew, camera.image_size, tuple(camera.params.tolist())


def load_rig_cameras(path: str | os.PathLike) -> Rig:
    """The cameras of a file of any format with their poses; the reference is the report's, otherwise the first
    camera.
    """
    found = files.read(path)
    cameras = {c.name: files.exact(c.camera) for c in found.cameras}
    poses = {c.name: c.pose for c in found.cameras if c.pose is not None}
    return Rig.in_frame_of(found.reference or found.names[0], cameras, poses)


def save_camera(
    camera: Camera | Rig,
    path: str | os.PathLike,
    to: str | None = None,
    force: bool = False,
    command: Sequence[str] = (),
) -> dict[str, float]:
    """Write a camera or a rig in the format of a program.

    Parameters
    ----------
    path : path
    to : str, optional
        The format, of `camcal list formats`; from the ending of the name otherwise.
    command : sequence of str, optional
        What a document of camcal's says of where it comes from.

    Returns
    -------
    mapping of path -> float
        The largest difference over the image, px, between the camera and what reads back.

    Raises
    ------
    UsageError
        If the format has no room for a term, which is named, or the file exists.
    """
    if isinstance(camera, Rig):
        named = tuple(NamedCamera(n, c, camera.cam_from_rig[n]) for n, c in camera.cameras.items())
    else:
        named = (NamedCamera("camera", camera, Pose.identity()),)
    if (to or format_of(path)) == "camcal":
        save(cameras_document(CameraFile(named), command), path, force)
        return {str(path): 0.0}
    return {p: gap.max_px for p, gap in files.write(path, CameraFile(named), to, force).items()}
