"""A camera by itself as a document: what `camcal evaluate`, `compare`, `convert` and `undistort` take."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from camcal.model.camera import Camera
from camcal.report.document import tool
from camcal.report.plain import plain
from camcal.report.schema import SCHEMA


def camera_document(camera: Camera, command: Sequence[str] = (), **more: Any) -> dict[str, Any]:
    """The document of a camera without the data it came from; `more` are further entries.

    The `camera` entry is that of a report, its parameters without standard deviations.
    """
    made: Mapping[str, Any] = {
        "schema": SCHEMA,
        "tool": tool(),
        "command": list(command),
        "camera": {
            "model": camera.lens.name,
            "image_size": camera.image_size,
            "pixel_center": "integer",
            "matrix": camera.matrix,
            "parameters": {
                name: {"value": value, "sigma": None, "start": value, "fixed": False}
                for name, value in camera.values.items()
            },
        },
        **more,
    }
    return plain(made)
