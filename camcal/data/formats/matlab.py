"""MATLAB's cameraParameters, cameraIntrinsics, stereoParameters and fisheyeIntrinsics as structs in a .mat file.

The centre of the top-left pixel is (1, 1), ImageSize is rows, columns, and IntrinsicMatrix is transposed.
"""

from __future__ import annotations

import io
from typing import Any

import numpy as np

from camcal.data.formats.base import Array, CameraFile, Format, NamedCamera, floats, image_size, matrix_values
from camcal.data.formats.matfile import AS_STRUCT, DEEPEST
from camcal.data.formats.source import Source
from camcal.data.formats.terms import Terms, camera_of, choose, polynomial
from camcal.errors import DataError, UsageError
from camcal.model.camera import Camera
from camcal.model.pose import Pose

MODELS = ("opencv4+skew", "opencv5+skew")
NEEDED = "fc (Bouguet), FocalLength, IntrinsicMatrix or K"


def _sniff(source: Source) -> bool:
    return source.kind in ("mat", "hdf5")


def _find(value: Any, depth: int = 0) -> Any:
    """The first struct that is a camera or a pair, including nested structs."""
    if _is_camera(value) or hasattr(value, "CameraParameters1"):
        return value
    for child in vars(value).values() if hasattr(value, "__dict__") and depth <= DEEPEST else ():
        found = _find(child, depth + 1)
        if found is not None:
            return found
    return None


def _is_camera(value: Any) -> bool:
    return any(hasattr(value, n) for n in ("FocalLength", "IntrinsicMatrix", "MappingCoefficients")) or (
        hasattr(value, "K") and hasattr(value, "RadialDistortion")
    )


def _read(source: Source) -> CameraFile:
    variables = source.mat
    found = next((f for v in variables.values() if (f := _find(v)) is not None), None)
    if found is None and "IntrinsicMatrix" in variables:
        found = type("Struct", (), variables)
    if found is None:
        objects = [n for n, v in variables.items() if v is None]
        if objects or not variables:
            raise DataError(
                "it holds a MATLAB object (a session or cameraParameters), which only MATLAB can read.",
                AS_STRUCT,
            )
        raise DataError(
            f"it holds no camera: it has none of {NEEDED}.",
            "A file of corners without a camera is not a camera file.",
        )
    if hasattr(found, "CameraParameters1"):
        return _pair(found)
    return _one(found)


def _one(found: Any) -> CameraFile:
    if hasattr(found, "Intrinsics") and not hasattr(found, "FocalLength"):
        found = found.Intrinsics
    if hasattr(found, "MappingCoefficients"):
        return _fisheye(found)
    return CameraFile.one(_camera(found))


def _pair(found: Any) -> CameraFile:
    """stereoParameters: x_2 = R' x_1 + t, because MATLAB's rotation multiplies rows from the right."""
    turn = np.asarray(found.RotationOfCamera2, float).reshape(3, 3).T
    pose = Pose(turn, floats(found.TranslationOfCamera2, 3, "TranslationOfCamera2"))
    first = NamedCamera("camera1", _camera(found.CameraParameters1), Pose.identity())
    return CameraFile((first, NamedCamera("camera2", _camera(found.CameraParameters2), pose)))


def _size(found: Any) -> tuple[int, int] | None:
    given = np.ravel(getattr(found, "ImageSize", []))
    return image_size(given[1], given[0]) if len(given) == 2 else None


def _camera(found: Any) -> Camera:
    if hasattr(found, "FocalLength"):
        fx, fy = floats(np.ravel(found.FocalLength)[[0, -1]], 2)
        cx, cy = floats(found.PrincipalPoint, 2, "PrincipalPoint")
        matrix = (fx, fy, cx, cy, float(np.ravel(getattr(found, "Skew", 0.0))[0]))
    elif hasattr(found, "K"):
        matrix = matrix_values(found.K)
    else:
        matrix = matrix_values(np.asarray(found.IntrinsicMatrix, float).reshape(3, 3).T)
    fx, fy, cx, cy, skew = matrix
    radial = floats(found.RadialDistortion, (0, 2, 3), "RadialDistortion").tolist()
    tangential = floats(getattr(found, "TangentialDistortion", []), (0, 2), "TangentialDistortion").tolist()
    return polynomial((fx, fy, cx - 1, cy - 1, skew), _size(found), radial, tangential)


def _fisheye(found: Any) -> CameraFile:
    """fisheyeIntrinsics: (u, v, a0 + a2 r² + a3 r³ + a4 r⁴), Scaramuzza's polynomial with MATLAB's forward axis.

    StretchMatrix [c d; e 1] takes (u, v) to the picture. Where e is not 0 it is an upper triangular matrix
    times a turn about the axis, which the pose holds.
    """
    a0, a2, a3, a4 = floats(found.MappingCoefficients, 4, "MappingCoefficients")
    stretch = np.asarray(getattr(found, "StretchMatrix", np.eye(2)), float).reshape(2, 2)
    cx, cy = floats(found.DistortionCenter, 2, "DistortionCenter")
    if a0 <= 0:
        raise ValueError("a0 of MappingCoefficients is not above 0")
    upper, angle = triangular(stretch)
    scale = upper[1, 1]  # a turn leaves the radius alone; the stretch is measured against its second row
    k = [a2 * a0, a3 * a0**2, a4 * a0**3]
    matrix = (a0 * upper[0, 0], a0 * scale, cx - 1, cy - 1, a0 * upper[0, 1])
    camera = camera_of("scaramuzza:4", matrix, _size(found), dict(zip(("c2", "c3", "c4"), k, strict=True)))
    notes = (
        ()
        if not angle
        else (
            f"the stretch matrix contains a rotation of {np.degrees(angle):.4g} degrees about the "
            f"optical axis, which is left to the pose",
        )
    )
    return CameraFile.one(camera, "camera", *notes)


def triangular(affine: Array) -> tuple[Array, float]:
    """An upper triangular matrix U and an angle with affine = U [[cos, -sin], [sin, cos]]."""
    if affine[1, 0] == 0:
        return affine, 0.0
    angle = float(np.arctan2(affine[1, 0], affine[1, 1]))
    c, s = np.cos(angle), np.sin(angle)
    return affine @ np.array([[c, s], [-s, c]]), angle


def _struct(terms: Terms, size: tuple[int, int]) -> dict[str, Any]:
    radial = terms.get("k1", "k2", "k3")
    return {
        "FocalLength": [terms.fx, terms.fy],
        "PrincipalPoint": [terms.cx + 1, terms.cy + 1],
        "ImageSize": [float(size[1]), float(size[0])],
        "RadialDistortion": radial if radial[2] else radial[:2],
        "TangentialDistortion": terms.get("p1", "p2"),
        "Skew": terms.skew,
    }


def _write(cameras: CameraFile, suffix: str) -> bytes:
    from scipy.io import savemat

    if len(cameras.cameras) > 2:
        raise UsageError(
            "a MATLAB struct holds one camera or a stereo pair.", f"Choose one: --camera {cameras.names[0]}"
        )
    structs = [
        _struct(choose(c.camera, MODELS, "MATLAB's cameraParameters")[1], c.camera.image_size)
        for c in cameras.cameras
    ]
    if len(structs) == 1:
        variables: dict[str, Any] = {"intrinsics": structs[0]}
    else:
        if not cameras.has_poses:
            raise UsageError(
                "MATLAB's stereo parameters need the pose of the second camera.",
                "Write a file for each camera: {camera}.mat",
            )
        left, right = (c.pose for c in cameras.cameras)
        assert left is not None and right is not None
        pose = right @ left.inverse()
        variables = {
            "stereoParams": {
                "CameraParameters1": structs[0],
                "CameraParameters2": structs[1],
                "RotationOfCamera2": pose.rotation.T,
                "TranslationOfCamera2": pose.translation,
            }
        }
    out = io.BytesIO()
    savemat(out, variables, format="5")
    return out.getvalue()


FORMAT = Format(
    "matlab",
    "a MATLAB struct",
    (".mat",),
    _sniff,
    _read,
    _write,
    MODELS,
    several=True,
    poses=True,
    centre="(1, 1)",
    order="FocalLength fx fy, PrincipalPoint, Skew, RadialDistortion k1 k2 [k3], TangentialDistortion p1 p2; "
    "ImageSize rows columns",
    traps=(
        "Only MATLAB reads its objects (cameraParameters, sessions of its app): save toStruct(params).",
        "IntrinsicMatrix is the transpose of the camera matrix; K, in newer releases, is not transposed.",
        "ImageSize is rows, columns; the principal point counts from 1.",
        "RotationOfCamera2 multiplies row vectors: it is the transpose of the rotation.",
        "Files of version 7.3 need the package h5py (`pip install camcal[matlab]`); or save with -v7.",
    ),
    source="MathWorks, cameraIntrinsics, cameraParameters, stereoParameters, fisheyeIntrinsics",
)
