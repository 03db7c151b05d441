"""Documents of cameras without data, which every command that takes a camera accepts."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from camcal.model.camera import Camera
from camcal.model.pose import Array
from camcal.report.head import head
from camcal.report.plain import plain

if TYPE_CHECKING:  # reports of a calibration need none of the formats
    from camcal.data.formats.base import CameraFile


def camera_document(camera: Camera, command: Sequence[str] = (), **more: Any) -> dict[str, Any]:
    """The document of a camera without its data; `more` are further entries.

    The `camera` entry is that of a report, its parameters without standard deviations.
    """
    from camcal.data.formats.base import CameraFile

    return cameras_document(CameraFile.one(camera), command, **more)


def cameras_document(cameras: CameraFile, command: Sequence[str] = (), **more: Any) -> dict[str, Any]:
    """The document of the cameras of a file: `camera`, or `cameras` and, with poses, `rig`."""
    made = head(command)
    if len(cameras.cameras) == 1:
        made["camera"] = camera_entry(cameras.cameras[0].camera)
    else:
        made["cameras"] = {c.name: camera_entry(c.camera) for c in cameras.cameras}
        from camcal.data.formats.camcal import rig_entry

        rig = rig_entry(cameras)
        if rig is not None:
            made["rig"] = rig
    return plain(made | more)


def sigma_entry(sigma: Array | None) -> dict[str, Any]:
    """The standard deviations (6,) of a pose, rad and length, in a report: angles in degrees; None if unknown."""
    return {
        "sigma_rotation_deg": None if sigma is None else np.degrees(sigma[:3]),
        "sigma_translation": None if sigma is None else sigma[3:],
    }


def camera_entry(
    camera: Camera,
    sigmas: Mapping[str, float | None] | None = None,
    start: Mapping[str, float] | None = None,
    fixed: Collection[str] = (),
) -> dict[str, Any]:
    """The report's `camera`: value, sigma, start and the fixed flag of each parameter.

    Without `start`, the start of a parameter is its value; without `sigmas`, none are written.
    """
    sigmas, start = sigmas or {}, start or {}
    return {
        "model": camera.lens.name,
        "image_size": camera.image_size,
        "pixel_center": "integer",
        "matrix": camera.matrix,
        "parameters": {
            name: {
                "value": value,
                "sigma": None if name in fixed else sigmas.get(name),
                "start": start.get(name, value),
                "fixed": name in fixed,
            }
            for name, value in camera.values.items()
        },
    }
