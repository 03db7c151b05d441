"""Bouguet's Camera Calibration Toolbox: Calib_Results.m and .mat, Calib_Results_stereo.mat.

The toolbox subtracts MATLAB's one: the centre of the top-left pixel is (0, 0). alpha_c is skew / fx.
"""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from camcal.data.formats.base import CameraFile, Format, NamedCamera, floats, image_size, number
from camcal.data.formats.source import Source
from camcal.data.formats.terms import Terms, choose, fisheye, polynomial
from camcal.errors import UsageError
from camcal.geometry import rotations
from camcal.model.camera import Camera
from camcal.model.pose import Pose

MODELS = ("opencv4+skew", "opencv5+skew")
_ASSIGNMENT = re.compile(r"^[ \t]*(\w+)[ \t]*=[ \t]*(?:\[([^\]]*)\]|([^;\[\]\n]*))[ \t]*;", re.M)


def _sniff(source: Source) -> bool:
    if source.kind == "mat":
        return "fc" in source.mat or "fc_left" in source.mat
    return source.kind == "text" and bool(re.search(r"^\s*(fc|fc_left)\s*=", source.text or "", re.M))


def _variables(source: Source) -> dict[str, Any]:
    """The numeric assignments of a script; other lines are ignored, nothing is executed."""
    if source.kind == "mat":
        return source.mat
    found: dict[str, Any] = {}
    for name, listed, plain in _ASSIGNMENT.findall(re.sub(r"%.*", "", source.text or "")):
        words = (listed or plain).replace(";", " ").replace(",", " ").split()
        try:
            found[name] = [float(w) for w in words]
        except ValueError:
            continue
    return found


def _read(source: Source) -> CameraFile:
    found = _variables(source)
    if "fc_left" not in found:
        return CameraFile.one(_camera(found, ""))
    pose = None
    if "T" in found and ("om" in found or "R" in found):
        turn = (
            rotations.exp(floats(found["om"], 3, "om")) if "om" in found else np.reshape(found["R"], (3, 3))
        )
        pose = Pose(turn, floats(found["T"], 3, "T"))
    left = NamedCamera("left", _camera(found, "_left"), None if pose is None else Pose.identity())
    return CameraFile((left, NamedCamera("right", _camera(found, "_right"), pose)))


def _camera(found: Mapping[str, Any], end: str) -> Camera:
    (fx, fy), (cx, cy) = floats(found["fc" + end], 2, "fc"), floats(found["cc" + end], 2, "cc")
    alpha = float(floats(found.get("alpha_c" + end, 0.0), 1, "alpha_c")[0])
    k = floats(found["kc" + end], (1, 2, 3, 4, 5, 6), "kc")
    size = None
    if "nx" in found and "ny" in found:
        size = image_size(*floats(found["nx"], 1, "nx"), *floats(found["ny"], 1, "ny"))
    matrix = (fx, fy, cx, cy, fx * alpha)
    if "est_fisheye" in found or ("fisheye" in found and np.any(found["fisheye"])):
        return fisheye(matrix, size, floats(k, 4, "kc of a fisheye camera"))
    d = np.r_[k, np.zeros(6)]
    if d[5]:
        raise ValueError("kc has a sixth coefficient, which the toolbox does not have")
    return polynomial(matrix, size, d[[0, 1, 4]].tolist(), d[2:4].tolist())


def _values(camera: Camera, end: str) -> dict[str, list[float]]:
    _, terms = choose(camera, MODELS, "Bouguet's toolbox")
    return _terms(terms, end)


def _terms(terms: Terms, end: str) -> dict[str, list[float]]:
    return {
        "fc" + end: [terms.fx, terms.fy],
        "cc" + end: [terms.cx, terms.cy],
        "alpha_c" + end: [terms.skew / terms.fx],
        "kc" + end: terms.get("k1", "k2", "p1", "p2", "k3"),
    }


def _write(cameras: CameraFile, suffix: str) -> str | bytes:
    if len(cameras.cameras) > 2:
        raise UsageError(
            "files of Bouguet's toolbox hold one camera or two.", f"Choose one: --camera {cameras.names[0]}"
        )
    width, height = cameras.cameras[0].camera.image_size
    if len(cameras.cameras) == 1:
        values = _values(cameras.cameras[0].camera, "")
    else:
        values = _values(cameras.cameras[0].camera, "_left") | _values(cameras.cameras[1].camera, "_right")
        values |= _between(cameras)
        if cameras.cameras[1].camera.image_size != (width, height):
            raise UsageError(
                "a stereo file of Bouguet's toolbox has one image size for both cameras.",
                "Write a file for each camera: Calib_{camera}.m",
            )
    if suffix == ".mat":
        from scipy.io import savemat

        out = io.BytesIO()
        columns = {n: np.array(v).reshape(-1, 1) for n, v in values.items()}
        savemat(out, {**columns, "nx": float(width), "ny": float(height)}, format="5")
        return out.getvalue()
    lines = [
        f"{n} = [ {' ; '.join(map(number, v))} ];" if len(v) > 1 else f"{n} = {number(v[0])};"
        for n, v in values.items()
    ]
    return "% written by camcal\n\n" + "\n\n".join(lines) + f"\n\nnx = {width};\nny = {height};\n"


def _between(cameras: CameraFile) -> dict[str, list[float]]:
    if not cameras.has_poses:
        return {}
    left, right = (c.pose for c in cameras.cameras)
    assert left is not None and right is not None
    pose = right @ left.inverse()
    return {"om": rotations.log(pose.rotation).tolist(), "T": pose.translation.tolist()}


FORMAT = Format(
    "bouguet",
    "a file of Bouguet's toolbox",
    (".m", ".mat"),
    _sniff,
    _read,
    _write,
    MODELS,
    several=True,
    poses=True,
    order="fc, cc, alpha_c (skew over fx), kc = k1 k2 p1 p2 k3; om, T: x_right = R x_left + T",
    traps=(
        "The toolbox counts pixels from 0, unlike MATLAB's own functions.",
        "The script is read line by line and not executed.",
        "The .mat file of one camera holds the skew as alpha_c, which has to be multiplied by fc(1).",
    ),
    source="J.-Y. Bouguet, Camera Calibration Toolbox for MATLAB, description of the parameters",
)
