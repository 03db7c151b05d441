"""The camera of a simulation, and the document of all true values."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from camcal.errors import UsageError
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Poses
from camcal.version import __version__

TRUTH_SCHEMA = "camcal-truth/1"


def example_camera(
    model: str,
    image_size: tuple[int, int] | None = None,
    values: Mapping[str, float | None] | None = None,
    skew: bool = False,
) -> Camera:
    """The first example camera of a model, with another size and other values if given.

    Another size scales fx, fy, cx, cy and the skew, so that the view stays the same; `values` are set last.

    Raises
    ------
    UsageError
        If the model, or a parameter, is unknown.
    """
    lens = lenses.make(model, skew)
    params, size = lens.examples()[0]
    params = np.array(params, float)
    if image_size is not None and tuple(image_size) != tuple(size):
        factor = np.array(image_size, float) / size
        scale = min(factor)
        shift = (np.array(image_size) - 1) / 2 - scale * (np.array(size) - 1) / 2
        for i, parameter in enumerate(lens.parameters):
            if parameter.group in ("focal", "principal", "skew"):
                params[i] *= scale
        params[2:4] += shift
        size = (int(image_size[0]), int(image_size[1]))
    for name, value in (values or {}).items():
        if value is None:
            raise UsageError(f"no value is given for '{name}'.", f"Try: --set {name}=0")
        params[lens.index(name)] = value
    return Camera(lens, params, size)


def truth_document(camera: Camera, poses: Poses, names: list[str], **more: Any) -> dict[str, Any]:
    """The true values of simulated data as plain values; `camera` and `views` as in a report."""
    return {
        "schema": TRUTH_SCHEMA,
        "tool": {"camcal": __version__},
        **more,
        "camera": {
            "model": camera.lens.name,
            "image_size": list(camera.image_size or ()),
            "pixel_center": "integer",
            "matrix": camera.matrix.tolist(),
            "parameters": {name: {"value": value} for name, value in camera.values.items()},
        },
        "views": [
            {"id": name, "cam_from_board": pose.entry()} for name, pose in zip(names, poses, strict=True)
        ],
    }
