"""mrcal's .cameramodel: a Python literal, parsed as data and never executed."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from camcal.data.formats.base import (
    Array,
    CameraFile,
    Format,
    NamedCamera,
    floats,
    image_size,
    number,
    unknown,
)
from camcal.data.formats.foreign import at_angle, foreign_camera
from camcal.data.formats.literal import literal
from camcal.data.formats.opencv import COUNTS, ORDER
from camcal.data.formats.source import Source
from camcal.data.formats.terms import camera_of, choose
from camcal.errors import DataError
from camcal.geometry import rotations
from camcal.model.pose import Pose

#: lens models with a counterpart -> camcal's spec
LENSES = {
    "PINHOLE": "pinhole",
    "OPENCV4": "opencv4",
    "OPENCV5": "opencv5",
    "OPENCV8": "opencv8",
    "OPENCV12": "opencv12",
    "STEREOGRAPHIC": "ucm",
}
#: models of one formula that are refitted
OTHERS = ("LATLON", "LONLAT", "CAHVOR")
#: knots to a side: those that a cubic reaches, and a hundred times what mrcal's own models have
LEAST_KNOTS, MOST_KNOTS = 4, 1000
MODELS = ("pinhole", "opencv4", "opencv5", "opencv8", "opencv12")
SPLINED = re.compile(r"SPLINED_STEREOGRAPHIC_order=([23])_Nx=(\d+)_Ny=(\d+)_fov_x_deg=(\d+(?:\.\d+)?)")


def _sniff(source: Source) -> bool:
    text = source.text or ""
    return source.kind in ("text", "json") and "LENSMODEL_" in text and "imagersize" in text


def _literal(text: str) -> Mapping[str, Any]:
    try:
        found = literal(re.sub(r"^\s*#.*$", "", text, flags=re.M).strip())
    except ValueError as error:
        raise DataError(f"{error}.", "Is it damaged?") from None
    if not isinstance(found, dict):
        raise DataError("it holds no mapping.", "Is it a .cameramodel?")
    return found


def _read(source: Source) -> CameraFile:
    found = _literal(source.text or "")
    name = str(found["lensmodel"]).removeprefix("LENSMODEL_")
    size = image_size(*found["imagersize"])
    camera = _camera(name, floats(found["intrinsics"], None, "intrinsics"), size)
    # 2.5 calls the pose rt_cam_ref and writes the old name beside it
    rt = floats(found.get("rt_cam_ref", found.get("extrinsics", [0] * 6)), 6, "extrinsics")
    pose = Pose(rotations.exp(rt[:3]), rt[3:])
    return CameraFile((NamedCamera("camera", camera, pose),))


def _camera(name: str, values: Array, size: tuple[int, int]) -> Any:
    matrix, rest = (*values[:4].tolist(), 0.0), values[4:]
    splined = SPLINED.fullmatch(name)
    if splined:
        return _splined(name, splined, matrix, rest, size)
    if name.startswith("CAHVORE"):
        raise DataError(
            f"LENSMODEL_{name} is not a central camera model; camcal has central models only.",
            "Refit it in mrcal: mrcal-convert-lensmodel.",
        )
    if name in OTHERS:
        return _other(name, matrix, rest, size)
    if name not in LENSES:
        raise unknown("lensmodel", f"LENSMODEL_{name}", [f"LENSMODEL_{n}" for n in (*LENSES, *OTHERS)])
    if name == "STEREOGRAPHIC":
        floats(rest, 0, "distortion")
        return camera_of("ucm", matrix, size, {"alpha": 0.5})
    floats(rest, {s: n for n, s in COUNTS.items()}[LENSES[name]], f"the distortion of LENSMODEL_{name}")
    return camera_of(LENSES[name], matrix, size, dict(zip(ORDER, rest.tolist(), strict=False)))


def _other(name: str, matrix: Any, rest: Array, size: tuple[int, int]) -> Any:
    """Models that camcal does not have, as formulas for a refit."""

    def rays(w: Array) -> Array:
        return at_angle(w)

    def latlon(w: Array) -> Array:
        x, y, z = rays(w).T
        return (
            np.c_[np.arctan2(x, z), np.arcsin(y)]
            if name == "LONLAT"
            else np.c_[np.arcsin(x), np.arctan2(y, z)]
        )

    def cahvor(w: Array) -> Array:
        alpha, beta, r0, r1, r2 = rest.tolist()
        axis = np.array([np.sin(alpha) * np.cos(beta), np.sin(beta), np.cos(alpha) * np.cos(beta)])
        v = rays(w)
        omega = v @ axis
        tau = 1 / omega**2 - 1
        mu = r0 + tau * (r1 + tau * r2)
        seen = v * (mu + 1)[:, None] - (omega * mu)[:, None] * axis
        return seen[:, :2] / seen[:, 2:]

    if name == "CAHVOR":
        floats(rest, 5, "the distortion of LENSMODEL_CAHVOR")
    forward = cahvor if name == "CAHVOR" else latlon
    reason = "camcal has no such lens"
    return foreign_camera(f"mrcal's LENSMODEL_{name}", reason, matrix, size, forward, at_angle)


def _splined(name: str, found: re.Match[str], matrix: Any, knots: Array, size: tuple[int, int]) -> Any:
    """mrcal, lens models: stereographic projection plus a B-spline surface over it."""
    order, nx, ny, fov = int(found[1]), int(found[2]), int(found[3]), float(found[4])
    if not all(LEAST_KNOTS <= n <= MOST_KNOTS for n in (nx, ny)) or not 0 < fov < 360:
        raise ValueError(f"the configuration of LENSMODEL_{name}")
    surface = floats(knots, 2 * nx * ny, f"the control points of LENSMODEL_{name}").reshape(ny, nx, 2)
    # the knots reach half an interval (order 2) or one (order 3) beyond the field of view on either side
    per_unit = (nx - 1 - (order - 1)) / (4 * np.tan(np.radians(fov) / 4))

    def forward(w: Array) -> Array:
        angle = np.linalg.norm(w, axis=1)
        # 2 tan(θ/2) along the direction of w
        u = w * np.where(angle > 0, 2 * np.tan(angle / 2) / np.where(angle > 0, angle, 1), 1.0)[:, None]
        at = u * per_unit + (np.array([nx, ny]) - 1) / 2
        return u + _surface(surface, at, order)

    reason = "camcal's spline maps pixels to rays, mrcal's maps rays to pixels"
    return foreign_camera(f"mrcal's LENSMODEL_{name}", reason, matrix, size, forward, at_angle)


def _surface(knots: Array, at: Array, order: int) -> Array:
    """A B-spline surface of order 2 or 3 at positions (N, 2) in units of the knots, clamped to the outermost
    pieces.
    """
    ny, nx = knots.shape[:2]
    if order == 3:
        first = np.clip(np.floor(at).astype(int), 1, np.array([nx, ny]) - 3)
        x = at - first
        weights = (
            np.stack([(1 - x) ** 3, 3 * x**3 - 6 * x**2 + 4, -3 * x**3 + 3 * x**2 + 3 * x + 1, x**3]) / 6
        )
    else:
        first = np.clip(np.floor(at + 0.5).astype(int), 1, np.array([nx, ny]) - 2)
        x = at - first
        weights = np.stack([(0.5 - x) ** 2 / 2, 0.75 - x**2, (0.5 + x) ** 2 / 2])
    total = np.zeros((len(at), 2))
    for i in range(len(weights)):
        for j in range(len(weights)):
            piece = knots[first[:, 1] - 1 + j, first[:, 0] - 1 + i]
            total += (weights[i, :, 0] * weights[j, :, 1])[:, None] * piece
    return total


def _write(cameras: CameraFile, suffix: str) -> str:
    named = cameras.cameras[0]
    spec, terms = choose(named.camera, MODELS, "an mrcal .cameramodel")
    count = {s: n for n, s in COUNTS.items()}[spec]
    values = [terms.fx, terms.fy, terms.cx, terms.cy, *terms.get(*ORDER[:count])]
    pose = named.pose or Pose.identity()
    rt = [*rotations.log(pose.rotation).tolist(), *pose.translation.tolist()]
    lens = {s: n for n, s in LENSES.items()}[spec]
    width, height = named.camera.image_size
    return (
        "# written by camcal\n{\n"
        f"    'lensmodel':  'LENSMODEL_{lens}',\n\n"
        f"    # intrinsics are fx,fy,cx,cy,distortion0,distortion1,....\n"
        f"    'intrinsics': [ {_list(values)},],\n\n"
        "    # extrinsics are rt_fromref\n"
        f"    'extrinsics': [ {_list(rt)},],\n\n"
        f"    'imagersize': [ {width}, {height},],\n"
        "}\n"
    )


def _list(values: list[float]) -> str:
    return ", ".join(map(number, values))


FORMAT = Format(
    "mrcal",
    "an mrcal .cameramodel",
    (".cameramodel",),
    _sniff,
    _read,
    _write,
    MODELS,
    poses=True,
    order="fx fy cx cy, then OpenCV's order; extrinsics: a rotation vector and a translation, x_cam = R x_ref + t",
    traps=(
        "The file is a Python literal; camcal parses it and executes nothing.",
        "The splined models map rays to pixels, camcal's spline the reverse: they are refitted.",
        "The inputs of mrcal's own optimisation in the file are omitted.",
    ),
    source="mrcal, cameramodels and lens models",
)
