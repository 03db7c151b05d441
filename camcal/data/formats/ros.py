"""ROS camera_info: the YAML and ini files of camera_calibration and camera_info_manager."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from camcal.data.formats.base import (
    CameraFile,
    Format,
    NamedCamera,
    floats,
    image_size,
    matrix_values,
    number,
    unknown,
)
from camcal.data.formats.opencv import COUNTS, ORDER, coefficients
from camcal.data.formats.source import Source
from camcal.data.formats.terms import Terms, camera_of, choose, fisheye
from camcal.errors import DataError
from camcal.model.camera import Camera

#: `distortion_model` -> the number of coefficients it may have; image_geometry hands them to OpenCV
NAMES = {
    "plumb_bob": (0, 4, 5),
    "rational_polynomial": (5, 8, 12, 14),
    "thin_prism": (12,),
    "equidistant": (4,),
    "fisheye": (4,),
}
MODELS = ("opencv4", "opencv5", "kb4", "opencv8", "opencv12", "opencv14")


def _sniff(source: Source) -> bool:
    if source.kind in ("yaml", "json"):
        found = source.mapping
        return isinstance(found.get("camera_matrix"), Mapping) and (
            "distortion_model" in found or "projection_matrix" in found or "camera_name" in found
        )
    return source.kind == "text" and bool(source.text and re.search(r"^\[image\]\s*$", source.text, re.M))


def _read(source: Source) -> CameraFile:
    return _read_ini(source.text or "") if source.kind == "text" else _read_yaml(source.mapping)


def _read_yaml(found: Mapping[str, Any]) -> CameraFile:
    size = image_size(found["image_width"], found["image_height"])
    if "distortion_model" not in found:
        raise DataError(
            "it has no 'distortion_model', which ROS files have.", "Try: distortion_model: plumb_bob"
        )
    bend = found.get("distortion_coefficients") or {"data": []}
    camera = make(
        found["distortion_model"], matrix_values(found["camera_matrix"]["data"]), size, bend["data"] or []
    )
    name = str(found.get("camera_name") or "camera")
    notes = []
    r = np.asarray((found.get("rectification_matrix") or {}).get("data", np.eye(3)), float).ravel()
    if r.size == 9 and not np.allclose(r, np.eye(3).ravel()):
        notes.append("the rectification (R and P) of the file belongs to its stereo pair and is left out")
    return CameraFile((NamedCamera(name, camera),), tuple(notes))


def make(model: Any, matrix: tuple[float, ...], size: tuple[int, int], bend: Any) -> Camera:
    """The camera of one of ROS's distortion models."""
    if model not in NAMES:
        raise unknown("distortion_model", model, NAMES)
    d = floats(bend, None, "distortion_coefficients")
    if len(d) not in NAMES[model]:
        raise DataError(
            f"distortion_model '{model}' has {len(d)} coefficients; "
            f"{' or '.join(map(str, NAMES[model]))} are needed.",
            "Was another model meant?",
        )
    if model in ("equidistant", "fisheye"):
        return fisheye(matrix, size, d)
    return camera_of(COUNTS[len(d)], matrix, size, dict(zip(ORDER, d.tolist(), strict=False)))


def _read_ini(text: str) -> CameraFile:
    """The ini format of camera_calibration_parsers: a name, then its numbers on the lines below."""
    lines = [
        line.strip()
        for line in text.splitlines()
        if line.strip() and not line.lstrip().startswith(("#", ";"))
    ]
    heads = [line[1:-1] for line in lines if line.startswith("[")]

    def numbers(name: str) -> list[float]:
        start, found = lines.index(name) + 1, []
        for line in lines[start:]:
            try:
                found += [float(w) for w in line.split()]
            except ValueError:
                break
        return found

    size = image_size(numbers("width")[0], numbers("height")[0])
    d = numbers("distortion")
    model = "plumb_bob" if len(d) <= 5 else "rational_polynomial"
    name = next((h for h in heads if h not in ("image", "externals")), "camera")
    return CameraFile.one(make(model, matrix_values(numbers("camera matrix")), size, d), name)


def _model(spec: str, terms: Terms) -> tuple[str, list[float]]:
    d = coefficients(spec, terms)
    if terms.kind == "fisheye":
        return "equidistant", d
    return ("plumb_bob" if len(d) <= 5 else "rational_polynomial"), d


def _write(cameras: CameraFile, suffix: str) -> str:
    named = cameras.cameras[0]
    ini = suffix == ".ini"
    spec, terms = choose(
        named.camera, MODELS[:2] if ini else MODELS, "ROS's ini file" if ini else "ROS camera_info"
    )
    model, d = _model(spec, terms)
    k = terms.matrix.ravel().tolist()
    turn, projection = named.rectification or (np.eye(3), np.c_[terms.matrix, np.zeros(3)])
    r, p = turn.ravel().tolist(), projection.ravel().tolist()
    width, height = named.camera.image_size
    if ini:
        return _ini(named.name, width, height, k, d, r, p)
    return (
        f"image_width: {width}\nimage_height: {height}\ncamera_name: {_name(named.name)}\n"
        + _matrix("camera_matrix", 3, 3, k)
        + f"distortion_model: {model}\n"
        + _matrix("distortion_coefficients", 1, len(d), d)
        + _matrix("rectification_matrix", 3, 3, r)
        + _matrix("projection_matrix", 3, 4, p)
    )


def _name(name: str) -> str:
    """A name for ROS, which accepts only letters, digits and underscores."""
    return re.sub(r"\W", "_", name, flags=re.ASCII) or "camera"


def _matrix(name: str, rows: int, columns: int, values: list[float]) -> str:
    data = ", ".join(_yaml_number(v) for v in values)
    return f"{name}:\n  rows: {rows}\n  cols: {columns}\n  data: [{data}]\n"


def _yaml_number(value: float) -> str:
    """A number in a form that YAML 1.1 parses as a float: 1.0e-05, not 1e-05."""
    text = number(value)
    return text if "e" not in text or "." in text else text.replace("e", ".0e")


def _ini(
    name: str, width: int, height: int, k: list[float], d: list[float], r: list[float], p: list[float]
) -> str:
    def rows(values: list[float], columns: int) -> str:
        return "\n".join(
            " ".join(number(v) for v in values[i : i + columns]) for i in range(0, len(values), columns)
        )

    return (
        f"# written by camcal\n\n[image]\n\nwidth\n{width}\n\nheight\n{height}\n\n[{_name(name)}]\n\n"
        f"camera matrix\n{rows(k, 3)}\n\ndistortion\n{rows(d, 5)}\n\n\nrectification\n{rows(r, 3)}\n\n"
        f"projection\n{rows(p, 4)}\n\n"
    )


FORMAT = Format(
    "ros",
    "ROS camera_info",
    (".yaml", ".ini"),
    _sniff,
    _read,
    _write,
    MODELS,
    rectified=True,
    order="camera_matrix row by row; plumb_bob k1 k2 p1 p2 k3; rational_polynomial also k4 k5 k6; "
    "equidistant k1 k2 k3 k4",
    traps=(
        "Some files have five coefficients under rational_polynomial; they are read as OpenCV does, k4 to k6 as 0.",
        "For a time ROS melodic called the model `fisheye` instead of `equidistant`; both names are read.",
        "P is the projection matrix of the rectified image, not the calibration; camcal writes R = I and "
        "P = [K | 0] for one camera, and for a pair its rectification, with P[0, 3] = -f times the baseline.",
        "camera_name has letters, digits and underscores only.",
    ),
    source="ROS, camera_calibration_parsers and sensor_msgs/CameraInfo",
)
