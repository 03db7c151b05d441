"""PhotonVision's calibration JSON and WPILib's camera calibration: OpenCV's matrix and coefficients."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from camcal.data.formats.base import CameraFile, Format, floats, image_size, matrix_values, unknown
from camcal.data.formats.jsonform import dump, has
from camcal.data.formats.opencv import COUNTS, ORDER, coefficients
from camcal.data.formats.source import Source
from camcal.data.formats.terms import camera_of, choose
from camcal.errors import DataError
from camcal.model.camera import Camera

MODELS = ("opencv5", "opencv8")
#: `lensmodel` of newer files
LENSES = ("LENSMODEL_OPENCV", "LENSMODEL_OPENCV5", "LENSMODEL_OPENCV8")


def camera(matrix: Any, bend: Any, size: tuple[int, int] | None) -> Camera:
    """OpenCV's camera from nine numbers and 0, 4, 5, 8, 12 or 14 coefficients."""
    d = floats(bend, None, "the distortion")
    if len(d) not in COUNTS:
        raise DataError(
            f"{len(d)} distortion coefficients; 0, 4, 5, 8, 12 or 14 are needed.", "Is the file damaged?"
        )
    values = dict(zip(ORDER, d.tolist(), strict=False))
    return camera_of(COUNTS[len(d)], matrix_values(matrix), size, values)


def _sniff(source: Source) -> bool:
    return source.kind == "json" and has(source.mapping, "cameraIntrinsics", "resolution")


def _read(source: Source) -> CameraFile:
    found = source.mapping
    lens = found.get("lensmodel", LENSES[0])
    if lens not in LENSES:
        raise unknown("lensmodel", lens, LENSES)
    size = image_size(found["resolution"]["width"], found["resolution"]["height"])
    bend = found.get("distCoeffs", found.get("cameraExtrinsics"))
    if not isinstance(bend, Mapping):
        raise KeyError("distCoeffs")
    return CameraFile.one(camera(found["cameraIntrinsics"]["data"], bend["data"], size))


def _write(cameras: CameraFile, suffix: str) -> str:
    named = cameras.cameras[0]
    spec, terms = choose(named.camera, MODELS, "PhotonVision's JSON")
    width, height = named.camera.image_size
    d = coefficients(spec, terms)
    return dump(
        {
            "resolution": {"width": float(width), "height": float(height)},
            "cameraIntrinsics": {"rows": 3, "cols": 3, "type": 6, "data": terms.matrix.ravel().tolist()},
            "distCoeffs": {"rows": 1, "cols": len(d), "type": 6, "data": d},
            "calobjectWarp": [],
            "observations": [],
            "calobjectSize": {"width": 0.0, "height": 0.0},
            "calobjectSpacing": 0.0,
            "lensmodel": LENSES[0] if len(d) == 5 else LENSES[2],
        }
    )


def _sniff_wpilib(source: Source) -> bool:
    found = source.mapping if source.kind == "json" else {}
    if not has(found, "camera_matrix", "distortion_coefficients"):
        return False
    return all(
        isinstance(found[n], list) and np.ndim(found[n]) == 1
        for n in ("camera_matrix", "distortion_coefficients")
    )


def _read_wpilib(source: Source) -> CameraFile:
    found = source.mapping
    size = None
    if has(found, "image_width", "image_height"):
        size = image_size(found["image_width"], found["image_height"])
    return CameraFile.one(camera(found["camera_matrix"], found["distortion_coefficients"], size))


def _write_wpilib(cameras: CameraFile, suffix: str) -> str:
    named = cameras.cameras[0]
    spec, terms = choose(named.camera, ("opencv5", "opencv8", "opencv12", "opencv14"), "WPILib's JSON")
    return dump(
        {"camera_matrix": terms.matrix.ravel().tolist(), "distortion_coefficients": coefficients(spec, terms)}
    )


FORMAT = Format(
    "photonvision",
    "PhotonVision's JSON",
    (".json",),
    _sniff,
    _read,
    _write,
    MODELS,
    order="cameraIntrinsics row by row; distCoeffs in OpenCV's order",
    traps=("Older files call distCoeffs `cameraExtrinsics`.",),
    source="PhotonVision, CameraCalibrationCoefficients",
)
WPILIB = Format(
    "wpilib",
    "WPILib's JSON",
    (".json",),
    _sniff_wpilib,
    _read_wpilib,
    _write_wpilib,
    ("opencv5", "opencv8", "opencv12", "opencv14"),
    size=False,
    order="camera_matrix row by row in one list; distortion_coefficients in OpenCV's order",
    traps=("The file does not contain the size of the image.",),
    source="WPILib, wpical",
)
