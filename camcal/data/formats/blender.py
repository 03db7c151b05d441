"""Blender's camera presets for motion tracking: a Python script that sets `camera.NAME = VALUE`, line by line.

libmv, distortion_models.h, with y upwards and r of the point x/z, y/z:

    POLYNOMIAL, BROWN:  x_d = x (1 + k1 r² + ...) + p1 (r² + 2 x²) + 2 p2 x y                                   (1)
    DIVISION:           x_d = x / (1 + k1 r² + k2 r⁴)                                                          (2)
    NUKE:               x = x_d / (1 + k1 r_d² + k2 r_d⁴ + p1 y_d²), in half the longer side                   (3)

(1) is OpenCV's with p1 and p2 exchanged, and the sign of one turned by the axis; (2) is the denominator of OpenCV's
rational model; (3) is stated from the picture to the scene and is refitted.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from camcal.data.formats.base import Array, CameraFile, Format, floats, number, size_needed, unknown
from camcal.data.formats.foreign import backward_camera
from camcal.data.formats.literal import literal
from camcal.data.formats.source import Source
from camcal.data.formats.terms import choose, polynomial
from camcal.errors import DataError

MODELS = ("brown:radial=4,decentering=1",)
CAMERA = "tracking.camera"
_LINE = re.compile(r"^camera\.(\w+)\s*=\s*(.{1,200}?)\s*(?:#.*)?$", re.M)
KINDS = ("POLYNOMIAL", "BROWN", "DIVISION", "NUKE")
#: mm; what is written for the width of the sensor, which only Blender's field of view in mm depends on
SENSOR = 36.0


def _sniff(source: Source) -> bool:
    text = source.text if source.kind == "text" else None
    return text is not None and CAMERA in text and _LINE.search(text) is not None


def _values(source: Source) -> dict[str, Any]:
    """The values that the script sets; it is never executed."""
    found = {}
    for name, value in _LINE.findall(source.text or ""):
        try:
            found[name] = literal(value)
        except ValueError:
            raise DataError(
                f"camera.{name} is not a number, a text or a tuple.", "Is it a Blender preset?"
            ) from None
    return found


def _read(source: Source) -> CameraFile:
    found, size = _values(source), size_needed(source)

    def value(name: str, default: float = 0.0) -> float:
        return float(floats(found.get(name, default), 1, name)[0])

    width, height = size
    if "focal_length_pixels" in found:
        focal = value("focal_length_pixels")
    elif value("sensor_width") > 0 and value("focal_length") > 0:
        focal = value("focal_length") * width / value("sensor_width")
    else:
        raise DataError("it holds no focal length.", "Save the preset with its focal length.")
    centre = floats(found.get("principal_point_pixels", (width / 2, height / 2)), 2, "principal_point_pixels")
    aspect = value("pixel_aspect", 1.0)
    matrix = (focal, focal * aspect, centre[0] - 0.5, height - centre[1] - 0.5, 0.0)
    kind = str(found.get("distortion_model", "POLYNOMIAL"))
    if kind == "POLYNOMIAL":
        camera: Any = polynomial(matrix, size, [value(n) for n in ("k1", "k2", "k3")], [0.0, 0.0])
    elif kind == "BROWN":
        k, (p1, p2) = [value(f"brown_k{i}") for i in (1, 2, 3, 4)], (value("brown_p1"), value("brown_p2"))
        camera = polynomial(matrix, size, k, [-p2, p1])
    elif kind == "DIVISION":
        camera = polynomial(matrix, size, denominator=[value("division_k1"), value("division_k2"), 0.0])
    elif kind == "NUKE":
        terms = [value(n) for n in ("nuke_k1", "nuke_k2", "nuke_p1", "nuke_p2")]
        camera = _nuke(matrix, size, terms, focal)
    else:
        raise unknown("distortion model", kind, KINDS)
    return CameraFile.one(camera)


def _nuke(matrix: Any, size: tuple[int, int], terms: list[float], focal: float) -> Any:
    """A camera of (3); its lengths are over half the longer side, in square pixels."""
    k1, k2, p1, p2 = terms
    scale = focal / (max(size) / 2)

    def undistort(w: Array) -> Array:
        x2, y2 = (w[:, 0] * scale) ** 2, (w[:, 1] * scale) ** 2
        radial = 1 + k1 * (x2 + y2) + k2 * (x2 + y2) ** 2
        return np.c_[w[:, 0] / (radial + p1 * y2), w[:, 1] / (radial + p2 * x2)]

    if not any(terms):
        return polynomial(matrix, size)
    return backward_camera(
        "NUKE", "its distortion is defined from the image to the scene", matrix, size, undistort
    )


def _write(cameras: CameraFile, suffix: str) -> str:
    named = cameras.cameras[0]
    _, terms = choose(named.camera, MODELS, "a Blender camera preset")
    width, height = named.camera.image_size
    k, (p1, p2) = terms.get("k1", "k2", "k3", "k4"), terms.get("p1", "p2")
    values: dict[str, Any] = {
        "sensor_width": SENSOR,
        "pixel_aspect": terms.fy / terms.fx,
        "units": "PIXELS",
        "focal_length_pixels": terms.fx,
        "principal_point_pixels": (terms.cx + 0.5, height - terms.cy - 0.5),
        "distortion_model": "BROWN",
        **{f"brown_k{i}": v for i, v in enumerate(k, 1)},
        "brown_p1": p2,
        "brown_p2": 0.0 - p1,
    }
    lines = [f"camera.{n} = {_literal(v)}" for n, v in values.items()]
    return (
        "\n".join(
            [
                "import bpy",
                f"# image of {width}x{height} px",
                f"camera = bpy.context.edit_movieclip.{CAMERA}",
                "",
                *lines,
            ]
        )
        + "\n"
    )


def _literal(value: Any) -> str:
    if isinstance(value, str):
        return repr(value)
    return f"({', '.join(map(number, value))})" if isinstance(value, tuple) else number(value)


FORMAT = Format(
    "blender",
    "a Blender camera preset",
    (".py",),
    _sniff,
    _read,
    _write,
    MODELS,
    size=True,
    centre="(0.5, h - 0.5), from the bottom-left corner",
    order="focal_length_pixels, or focal_length (mm) of sensor_width; brown_k1 to k4, brown_p1 p2; y upwards",
    traps=(
        "brown_p1 acts on x and brown_p2 on y, which points up: OpenCV's p2 and -p1.",
        "pixel_aspect is the width of a pixel over its height: fy = pixel_aspect fx.",
        "Blender's own presets hold neither a principal point (the middle is taken) nor the image size: --image-size.",
        "DIVISION is defined from the scene to the image, unlike the division model of the literature.",
        "NUKE has no exact counterpart: it is refitted.",
    ),
    source="Blender, presets/tracking_camera and bpy.types.MovieTrackingCamera; libmv, distortion_models.h",
)
