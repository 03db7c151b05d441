"""transforms.json of nerfstudio and instant-ngp (colmap2nerf).

The centre of the top-left pixel is (0.5, 0.5), as COLMAP's. The poses of the frames, camera to world with
OpenGL's axes (y up, z backwards), are of pictures, not of a rig: they are omitted.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from camcal.data.formats.base import CameraFile, Format, NamedCamera, floats, image_size, unknown
from camcal.data.formats.jsonform import dump, has
from camcal.data.formats.source import Source
from camcal.data.formats.terms import choose, fisheye, polynomial
from camcal.errors import DataError

HALF = 0.5
NAMES = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV_FISHEYE")
MODELS = ("brown:radial=4,decentering=1", "kb4")
OWN = ("fl_x", "camera_angle_x")


def _sniff(source: Source) -> bool:
    found = source.mapping if source.kind == "json" else {}
    return any(n in found for n in OWN) or (
        isinstance(found.get("frames"), list) and any(has(f, "transform_matrix") for f in found["frames"])
    )


def _read(source: Source) -> CameraFile:
    found = source.mapping
    note = "the poses of the pictures (frames) are left out"
    frames = [f for f in found.get("frames") or [] if isinstance(f, Mapping)]
    if any(n in found for n in OWN):
        return CameraFile.one(_camera(found), "camera", *[note] * bool(frames))
    cameras = []
    for i, frame in enumerate(frames):
        if any(n in frame for n in OWN):
            cameras.append(NamedCamera(str(frame.get("file_path", i)), _camera({**found, **frame})))
    return CameraFile(tuple(cameras), (note,))


def _camera(found: Mapping[str, Any]) -> Any:
    model = found.get("camera_model", "OPENCV_FISHEYE" if found.get("is_fisheye") else "OPENCV")
    if model not in NAMES:
        raise unknown("camera_model", model, NAMES)
    size = image_size(found["w"], found["h"])
    fx = found.get("fl_x") or size[0] / 2 / math.tan(float(found["camera_angle_x"]) / 2)
    fy = found.get("fl_y") or (
        size[1] / 2 / math.tan(float(found["camera_angle_y"]) / 2) if "camera_angle_y" in found else fx
    )
    cx, cy = found.get("cx", size[0] / 2), found.get("cy", size[1] / 2)
    fx, fy, cx, cy, *d = floats(
        [fx, fy, cx, cy, *(found.get(n, 0.0) for n in ("k1", "k2", "k3", "k4", "p1", "p2"))]
    )
    matrix = (fx, fy, cx - HALF, cy - HALF, 0.0)
    if any(found.get(n) for n in ("k5", "k6")):
        raise DataError(
            "k5 or k6, which are not documented for transforms.json.",
            "Was the file written by another program?",
        )
    if model == "OPENCV_FISHEYE":
        if d[4] or d[5]:
            raise DataError(
                "a fisheye lens with p1 or p2, which OpenCV's fisheye model does not have.",
                "Check camera_model.",
            )
        return fisheye(matrix, size, d[:4])
    return polynomial(matrix, size, d[:4], d[4:])


def _write(cameras: CameraFile, suffix: str) -> str:
    named = cameras.cameras[0]
    _, terms = choose(named.camera, MODELS, "transforms.json")
    width, height = named.camera.image_size
    wide = terms.kind == "fisheye"
    made: dict[str, Any] = {
        "camera_model": "OPENCV_FISHEYE" if wide else "OPENCV",
        "fl_x": terms.fx,
        "fl_y": terms.fy,
        "cx": terms.cx + HALF,
        "cy": terms.cy + HALF,
        "w": width,
        "h": height,
        **dict(zip(("k1", "k2", "k3", "k4"), terms.get("k1", "k2", "k3", "k4"), strict=True)),
    }
    if wide:
        made["is_fisheye"] = True
    else:
        made |= dict(zip(("p1", "p2"), terms.get("p1", "p2"), strict=True))
    return dump({**made, "frames": []})


FORMAT = Format(
    "nerfstudio",
    "transforms.json",
    (".json",),
    _sniff,
    _read,
    _write,
    MODELS,
    centre="(0.5, 0.5)",
    order="fl_x fl_y cx cy; k1 k2 k3 k4 radial (of the angle for OPENCV_FISHEYE), p1 p2 as OpenCV's",
    traps=(
        "k4 is the fourth radial term, not OpenCV's denominator.",
        "Some programs ignore k3 and k4 when reading the file.",
        "The frames' matrices are world_from_camera with y up and z backwards.",
    ),
    source="nerfstudio, data conventions; instant-ngp, scripts/colmap2nerf.py",
)
