"""OpenCV's FileStorage: the files of its calibration samples, as written by versions 4.x and 5.0.

A camera is a matrix and the coefficients in cv2's order; how many there are says which of OpenCV's models it
is, `fisheye_model` that it is cv2.fisheye's and `xi` that it is cv2.omnidir's. A stereo file holds M1 D1 M2
D2 R T, where x_2 = R x_1 + T, and R1 R2 P1 P2 Q of the rectified pair.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any
from xml.etree import ElementTree

import numpy as np

from camcal.data.formats.base import (
    Array,
    CameraFile,
    Format,
    NamedCamera,
    floats,
    image_size,
    matrix_values,
    number,
)
from camcal.data.formats.source import Source
from camcal.data.formats.terms import Terms, camera_of, choose, fisheye, unified
from camcal.errors import DataError, UsageError
from camcal.geometry import rotations
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from camcal.registry import suggestion

#: the model by the number of coefficients: OpenCV's own rule
COUNTS = {0: "pinhole", 4: "opencv4", 5: "opencv5", 8: "opencv8", 12: "opencv12", 14: "opencv14"}
ORDER = ("k1", "k2", "p1", "p2", "k3", "d1", "d2", "d3", "s1", "s2", "s3", "s4", "tauX", "tauY")
#: names in lower case without underscores
MATRIX = ("cameramatrix", "k", "m", "intrinsicmatrix", "cameraintrinsics", "intrinsic", "mtx", "cammatrix")
BEND = (
    "distortioncoefficients",
    "distcoeffs",
    "d",
    "distcoeff",
    "distortion",
    "dist",
    "distortionparameters",
)
WIDTH, HEIGHT = ("imagewidth", "width", "imgwidth"), ("imageheight", "height", "imgheight")
SIZE = ("imagesize", "size", "resolution", "imgsize")
MODELS = ("pinhole", "opencv4", "opencv5", "opencv8", "opencv12", "opencv14", "kb4", "mei+skew")


def plain_keys(found: Mapping[str, Any]) -> dict[str, Any]:
    """A mapping with its keys in lower case without underscores."""
    return {str(k).lower().replace("_", ""): v for k, v in found.items()}


def _entries(source: Source) -> dict[str, Any]:
    """The top level of the file as plain values, by plain keys."""
    if source.kind == "xml":
        root = source.xml
        if root is None or root.tag != "opencv_storage":
            return {}
        return plain_keys({e.tag: _xml_value(e) for e in root})
    return plain_keys(source.mapping)


def _xml_value(element: ElementTree.Element) -> Any:
    if len(element):
        return {e.tag: _xml_value(e) for e in element}
    words = (element.text or "").split()
    try:
        numbers = [float(w) for w in words]
    except ValueError:
        return (element.text or "").strip()
    return numbers[0] if len(numbers) == 1 else numbers


def _pick(found: Mapping[str, Any], names: Sequence[str], end: str = "") -> Any:
    return next((found[n + end] for n in names if n + end in found), None)


def _sniff(source: Source) -> bool:
    if source.kind == "xml":
        return source.xml is not None and source.xml.tag == "opencv_storage"
    if source.kind not in ("yaml", "json"):
        return False
    found = _entries(source)
    if source.text and source.text.startswith("%YAML:"):
        return True
    if "distortionmodel" in found or "projectionmatrix" in found:
        return False  # ROS
    return (
        any(_is_matrix(_pick(found, MATRIX, end)) for end in ("", "1")) or "distortioncoefficients" in found
    )


def _is_matrix(value: Any) -> bool:
    try:
        return _array(value).size == 9 and not (isinstance(value, list) and np.ndim(value) == 1)
    except (ValueError, TypeError, KeyError):
        return False


def _array(value: Any) -> Array:
    """The numbers of an opencv-matrix, an nd-matrix or nested lists."""
    if isinstance(value, Mapping):
        value = value["data"]
    return np.asarray([] if value is None else value, float).ravel()


def _size(found: Mapping[str, Any]) -> tuple[int, int] | None:
    width, height = _pick(found, WIDTH), _pick(found, HEIGHT)
    if width is None or height is None:
        both = _pick(found, SIZE)
        if both is None:
            return None
        if isinstance(both, Mapping) and "width" in both:
            return image_size(both["width"], both["height"])
        return image_size(*floats(_array(both), 2, "the image size"))
    return image_size(width, height)


def _read(source: Source) -> CameraFile:
    found = _entries(source)
    if _pick(found, MATRIX) is not None:
        return CameraFile.one(_camera(found, ""), "camera", *_notes(found))
    if _pick(found, MATRIX, "1") is None:
        near = next((s for k in found if len(k) > 3 and (s := suggestion(k, MATRIX))), None)
        raise DataError(
            "it holds no camera: 'camera_matrix', 'K' or 'M1'.",
            near or "Is it the extrinsics file of a stereo pair?",
        )
    names, ends = [], []
    for i, name in enumerate(("left", "right", "camera3", "camera4"), 1):
        if _pick(found, MATRIX, str(i)) is not None:
            names.append(name)
            ends.append(str(i))
    poses: list[Pose | None] = [None] * len(ends)
    if "r" in found and "t" in found and len(ends) == 2:
        r = _array(found["r"])
        turn = rotations.exp(r) if r.size == 3 else floats(r, 9, "R").reshape(3, 3)
        poses = [Pose.identity(), Pose(turn, floats(_array(found["t"]), 3, "T"))]
    cameras = [NamedCamera(n, _camera(found, e), p) for n, e, p in zip(names, ends, poses, strict=True)]
    return CameraFile(tuple(cameras), _notes(found))


def _notes(found: Mapping[str, Any]) -> tuple[str, ...]:
    k = _array(_pick(found, MATRIX) if _pick(found, MATRIX) is not None else _pick(found, MATRIX, "1"))
    if k.size == 9 and k[1] and "xi" not in found:
        return ("the matrix has a skew, which OpenCV's own functions ignore",)
    return ()


def _camera(found: Mapping[str, Any], end: str) -> Camera:
    matrix = matrix_values(_array(_pick(found, MATRIX, end)))
    bend = floats(_array(_pick(found, BEND, end)), None, "the distortion coefficients")
    size = _size(found)
    model = str(found.get("distortionmodel", found.get("cameramodel", ""))).lower()
    xi = _array(found.get("xi" + end))
    if xi.size == 1:
        return unified(matrix, size, float(xi[0]), floats(bend, 4, "the distortion coefficients"))
    if _true(found.get("fisheyemodel")) or "fisheye" in model or "equidistant" in model:
        return fisheye(matrix, size, floats(bend, 4, "a fisheye camera's distortion"))
    if len(bend) not in COUNTS:
        raise DataError(
            f"the file has {len(bend)} distortion coefficients; OpenCV's models have 0, 4, 5, 8, 12 or 14.",
            "Is it the file of another camera model?",
        )
    return camera_of(COUNTS[len(bend)], matrix, size, dict(zip(ORDER, bend.tolist(), strict=False)))


def _true(value: Any) -> bool:
    return value not in (None, 0, 0.0, "0", "false", False)


# Writing


def coefficients(spec: str, terms: Terms) -> list[float]:
    """The distortion coefficients of a camera in cv2's order."""
    if terms.kind == "fisheye":
        return terms.get("k1", "k2", "k3", "k4")
    if terms.kind == "unified":
        return terms.get("k1", "k2", "p1", "p2")
    count = {spec: n for n, spec in COUNTS.items()}[spec.partition("+")[0]]
    return terms.get(*ORDER[: max(count, 5)])


def _write(cameras: CameraFile, suffix: str) -> str:
    if len(cameras.cameras) > 2:
        raise UsageError(
            f"an OpenCV file holds one camera or a stereo pair; {len(cameras.cameras)} cameras were given.",
            f"Choose one: --camera {cameras.names[0]}",
        )
    size = cameras.cameras[0].camera.image_size
    if any(c.camera.image_size != size for c in cameras.cameras):
        raise UsageError(
            "an OpenCV stereo file has one image size for both cameras.",
            "Write a file for each camera: cam-{camera}.yml",
        )
    entries: dict[str, Any] = {"image_width": size[0], "image_height": size[1]}
    if len(cameras.cameras) == 1:
        entries |= _one(cameras.cameras[0].camera, "camera_matrix", "distortion_coefficients", "xi", entries)
    else:
        for i, named in enumerate(cameras.cameras, 1):
            entries |= _one(named.camera, f"M{i}", f"D{i}", f"xi{i}", entries)
        entries |= _pair(cameras)
    return {".json": _as_json, ".xml": _as_xml}.get(suffix, as_yaml)(entries)


def _one(camera: Camera, matrix: str, bend: str, xi: str, before: Mapping[str, Any]) -> dict[str, Any]:
    spec, terms = choose(camera, MODELS, "an OpenCV file")
    made: dict[str, Any] = {}
    if "fisheye_model" in before and (terms.kind == "fisheye") != bool(before["fisheye_model"]):
        raise UsageError(
            "an OpenCV stereo file cannot combine a fisheye lens with another model.",
            "Write a file for each camera: cam-{camera}.yml",
        )
    if terms.kind == "fisheye":
        made["fisheye_model"] = 1
    elif matrix == "M1":
        made["fisheye_model"] = 0
    made[matrix] = terms.matrix
    made[bend] = np.array([coefficients(spec, terms)])
    if terms.kind == "unified":
        made[xi] = np.array([terms.get("xi")])
    return made


def _pair(cameras: CameraFile) -> dict[str, Any]:
    """R, T, the essential and the fundamental matrix of a pair with poses."""
    if not cameras.has_poses:
        return {}
    left, right = (c.pose for c in cameras.cameras)
    assert left is not None and right is not None
    between = right @ left.inverse()
    e = rotations.skew(between.translation) @ between.rotation
    k1, k2 = (np.linalg.inv(c.camera.matrix) for c in cameras.cameras)
    f = k2.T @ e @ k1
    made = {"R": between.rotation, "T": between.translation.reshape(3, 1), "E": e, "F": f / (f[2, 2] or 1.0)}
    return made | _rectification(cameras)


def _rectification(cameras: CameraFile) -> dict[str, Any]:
    """R1 R2 P1 P2 Q, named as by cv2.stereoRectify, if the pair can be rectified."""
    first, second = (c.rectification for c in cameras.cameras)
    if first is None or second is None:
        return {}
    (r1, p1), (r2, p2) = first, second
    along = p2[:2, 3]
    shift = float(along[np.abs(along).argmax()]) / p2[0, 0]
    q = [[1, 0, 0, -p1[0, 2]], [0, 1, 0, -p1[1, 2]], [0, 0, 0, p1[0, 0]], [0, 0, -1 / shift, 0]]
    return {"R1": r1, "R2": r2, "P1": p1, "P2": p2, "Q": np.array(q, float)}


def _rows(values: Array) -> list[str]:
    words = [number(v) for v in values.ravel().tolist()]
    return [", ".join(words[i : i + 4]) for i in range(0, len(words), 4)]


def as_yaml(entries: Mapping[str, Any]) -> str:
    """`%YAML:1.0`, which 4.x writes and both versions read."""
    lines = ["%YAML:1.0", "---"]
    for name, value in entries.items():
        if isinstance(value, np.ndarray):
            lines += [
                f"{name}: !!opencv-matrix",
                f"   rows: {value.shape[0]}",
                f"   cols: {value.shape[1]}",
                "   dt: d",
            ]
            lines.append("   data: [ " + ",\n       ".join(_rows(value)) + " ]")
        else:
            lines.append(f"{name}: {value}")
    return "\n".join(lines) + "\n"


def _as_xml(entries: Mapping[str, Any]) -> str:
    lines = ['<?xml version="1.0"?>', "<opencv_storage>"]
    for name, value in entries.items():
        if isinstance(value, np.ndarray):
            lines += [f'<{name} type_id="opencv-matrix">', f"  <rows>{value.shape[0]}</rows>"]
            lines += [f"  <cols>{value.shape[1]}</cols>", "  <dt>d</dt>", "  <data>"]
            lines.append(
                "    " + "\n    ".join(r.replace(",", "") for r in _rows(value)) + f"</data></{name}>"
            )
        else:
            lines.append(f"<{name}>{value}</{name}>")
    return "\n".join([*lines, "</opencv_storage>"]) + "\n"


def _as_json(entries: Mapping[str, Any]) -> str:
    made = {
        name: {
            "type_id": "opencv-matrix",
            "rows": v.shape[0],
            "cols": v.shape[1],
            "dt": "d",
            "data": v.ravel().tolist(),
        }
        if isinstance(v, np.ndarray)
        else v
        for name, v in entries.items()
    }
    return json.dumps(made, indent=4) + "\n"


FORMAT = Format(
    "opencv",
    "an OpenCV file",
    (".yml", ".xml", ".json"),
    _sniff,
    _read,
    _write,
    MODELS,
    several=True,
    poses=True,
    rectified=True,
    order="camera_matrix; k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 [tauX tauY]]]]; fisheye k1 k2 k3 k4; x_2 = R x_1 + T",
    traps=(
        "Four coefficients mean k1 k2 p1 p2, or cv2.fisheye's k1 to k4 where `fisheye_model` is 1.",
        "The skew in the matrix is read, although OpenCV's pinhole functions ignore it.",
        "Version 5.0 writes a single row as an nd-matrix, which 4.x cannot read; camcal writes a form "
        "that both read.",
        "Names vary: camera_matrix, Camera_Matrix, cameraMatrix, K, M1; distortion_coefficients, dist_coeffs, D.",
    ),
    source="OpenCV, samples/cpp/calibration.cpp, stereo_calib.cpp and the tutorial camera_calibration",
)
