"""Gyroflow's lens profiles for video stabilisation: OpenCV's fisheye or polynomial model."""

from __future__ import annotations

from typing import Any

from camcal.data.formats.base import CameraFile, Format, floats, image_size, matrix_values, unknown
from camcal.data.formats.jsonform import dump, has
from camcal.data.formats.source import Source
from camcal.data.formats.terms import camera_of, choose, fisheye

MODELS = ("kb4", "opencv5")
#: `distortion_model` of the file; left out, it is the first
NAMES = ("opencv_fisheye", "opencv_standard")


def _sniff(source: Source) -> bool:
    found = source.mapping if source.kind == "json" else {}
    return has(found, "fisheye_params", "calib_dimension")


def _read(source: Source) -> CameraFile:
    found = source.mapping
    name = found.get("distortion_model") or NAMES[0]
    if name not in NAMES:
        raise unknown("distortion_model", name, NAMES)
    size = image_size(found["calib_dimension"]["w"], found["calib_dimension"]["h"])
    lens = found["fisheye_params"]
    matrix = matrix_values(lens["camera_matrix"])
    if name == NAMES[0]:
        return CameraFile.one(
            fisheye(matrix, size, floats(lens["distortion_coeffs"], 4, "distortion_coeffs"))
        )
    d = floats(lens["distortion_coeffs"], (4, 5), "distortion_coeffs").tolist()
    values = dict(zip(("k1", "k2", "p1", "p2", "k3"), [*d, 0.0], strict=False))
    return CameraFile.one(camera_of("opencv5", matrix, size, values))


def _write(cameras: CameraFile, suffix: str) -> str:
    named = cameras.cameras[0]
    _, terms = choose(named.camera, MODELS, "a Gyroflow lens profile")
    width, height = named.camera.image_size
    wide = terms.kind == "fisheye"
    names = ("k1", "k2", "k3", "k4") if wide else ("k1", "k2", "p1", "p2", "k3")
    size = {"w": width, "h": height}
    content: dict[str, Any] = {
        "name": named.name,
        "camera_brand": "",
        "camera_model": named.name,
        "lens_model": "",
        "calib_dimension": size,
        "orig_dimension": size,
        "distortion_model": NAMES[0] if wide else NAMES[1],
        "fisheye_params": {"camera_matrix": terms.matrix.tolist(), "distortion_coeffs": terms.get(*names)},
    }
    return dump(content)


FORMAT = Format(
    "gyroflow",
    "a Gyroflow lens profile (JSON)",
    (".json",),
    _sniff,
    _read,
    _write,
    MODELS,
    order="camera_matrix row by row; distortion_coeffs k1..k4 of the fisheye, or k1 k2 p1 p2 k3",
    traps=(
        "A profile holds for the size and mode of the recording (calib_dimension): another crop needs its own.",
        "Other distortion models than OpenCV's two are refused by name.",
    ),
    source="Gyroflow, lens profile database",
)
