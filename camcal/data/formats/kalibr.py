"""Kalibr's camchain: a chain of cameras, each with its pose relative to the previous one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from camcal.data.formats.base import Array, CameraFile, Format, NamedCamera, floats, image_size, unknown
from camcal.data.formats.foreign import foreign_camera
from camcal.data.formats.ros import _yaml_number as number
from camcal.data.formats.source import Source
from camcal.data.formats.terms import Terms, camera_of, choose, fisheye, polynomial, unified
from camcal.errors import DataError
from camcal.model.pose import Pose

#: camera_model -> what stands before fu fv pu pv in `intrinsics`
CAMERAS = {"pinhole": (), "omni": ("xi",), "eucm": ("alpha", "beta"), "ds": ("xi", "alpha")}
#: distortion_model -> its number of coefficients
BENDS = {"none": 0, "radtan": 4, "equidistant": 4, "fov": 1}
MODELS = ("pinhole", "opencv4", "kb4", "fov", "eucm", "ds", "mei")


def _sniff(source: Source) -> bool:
    found = source.mapping if source.kind in ("yaml", "json") else {}
    return any(isinstance(v, Mapping) and "camera_model" in v and "intrinsics" in v for v in found.values())


def _read(source: Source) -> CameraFile:
    entries = {n: e for n, e in source.mapping.items() if isinstance(e, Mapping) and "intrinsics" in e}
    imu = all("T_cam_imu" in e for e in entries.values())
    chain = all("T_cn_cnm1" in e for e in list(entries.values())[1:]) and len(entries) > 1
    found, pose = [], Pose.identity()
    for i, (name, entry) in enumerate(entries.items()):
        if chain and i:
            pose = _pose(entry["T_cn_cnm1"]) @ pose
        elif not chain and imu:
            pose = _pose(entry["T_cam_imu"])
        known = pose if chain or imu else None
        found.append(NamedCamera(str(name), _camera(entry), known))
    left_out = chain and any("T_cam_imu" in e for e in entries.values())
    return CameraFile(tuple(found), ("the poses from the IMU (T_cam_imu) are left out",) * left_out)


def _pose(rows: Any) -> Pose:
    t = floats(rows, 16, "a pose").reshape(4, 4)
    return Pose(t[:3, :3], t[:3, 3])


def _camera(entry: Mapping[str, Any]) -> Any:
    model, bend = entry["camera_model"], entry.get("distortion_model", "none")
    if model not in CAMERAS:
        raise unknown("camera_model", model, CAMERAS)
    if bend not in BENDS:
        raise unknown("distortion_model", bend, BENDS)
    own = CAMERAS[model]
    values = floats(entry["intrinsics"], 4 + len(own), "intrinsics").tolist()
    first, matrix = dict(zip(own, values, strict=False)), (*values[len(own) :], 0.0)
    d = floats(entry.get("distortion_coeffs") or [], BENDS[bend], "distortion_coeffs").tolist()
    size = image_size(*entry["resolution"])
    if model == "pinhole":
        if bend == "equidistant":
            return fisheye(matrix, size, d)
        if bend == "fov":
            return camera_of("fov", matrix, size, {"w": d[0]})
        return polynomial(matrix, size, d[:2], d[2:])
    if model == "omni" and bend in ("radtan", "none"):
        return unified(matrix, size, first["xi"], d)
    if bend == "none" or not any(d):
        return camera_of(model if model != "omni" else "mei", matrix, size, first)
    return _foreign(model, bend, matrix, size, first, d)


def _foreign(
    model: str, bend: str, matrix: Any, size: tuple[int, int], first: Mapping[str, float], d: list[float]
) -> Any:
    """A distortion after a wide model, which camcal supports only for Mei's model."""
    inner = camera_of("mei" if model == "omni" else model, (1, 1, 0, 0, 0), size, first)
    outer = {
        "radtan": lambda: polynomial((1, 1, 0, 0, 0), size, d[:2], d[2:]),
        "equidistant": lambda: fisheye((1, 1, 0, 0, 0), size, d),
        "fov": lambda: camera_of("fov", (1, 1, 0, 0, 0), size, {"w": d[0]}),
    }[bend]()

    from camcal.data.formats.foreign import at_angle

    def forward(w: Array) -> Array:
        return outer.project(np.c_[inner.project(at_angle(w)), np.ones(len(w))])

    reason = f"camcal has no distortion '{bend}' after the model '{model}'"
    return foreign_camera(f"Kalibr's {model}-{bend}", reason, matrix, size, forward, at_angle)


def _write(cameras: CameraFile, suffix: str) -> str:
    text, before = "", None
    for i, named in enumerate(cameras.cameras):
        _, terms = choose(named.camera, MODELS, "a Kalibr camchain")
        model, bend, intrinsics, d = _entry(terms)
        width, height = named.camera.image_size
        # Kalibr's tools look for cam0, cam1, ...; the topic keeps the camera's own name
        text += f"cam{i}:\n  camera_model: {model}\n  intrinsics: {_list(intrinsics)}\n"
        text += f"  distortion_model: {bend}\n  distortion_coeffs: {_list(d)}\n  resolution: [{width}, {height}]\n"
        text += f"  rostopic: /{named.name}/image_raw\n"
        if i and cameras.has_poses:
            assert named.pose is not None and before is not None
            pose = named.pose @ before.inverse()
            text += "  T_cn_cnm1:\n"
            for row in np.vstack([np.c_[pose.rotation, pose.translation], [0, 0, 0, 1]]).tolist():
                text += f"  - {_list(row)}\n"
        before = named.pose
    if len(cameras.cameras) > 1 and not cameras.has_poses:
        raise DataError(
            "a Kalibr camchain of several cameras needs their poses; these have none.",
            "Write a file for each camera: {camera}.yaml",
        )
    return text


def _entry(terms: Terms) -> tuple[str, str, list[float], list[float]]:
    matrix = [terms.fx, terms.fy, terms.cx, terms.cy]
    if terms.kind == "polynomial":
        return "pinhole", "radtan", matrix, terms.get("k1", "k2", "p1", "p2")
    if terms.kind == "fisheye":
        return "pinhole", "equidistant", matrix, terms.get("k1", "k2", "k3", "k4")
    if terms.kind == "fov":
        return "pinhole", "fov", matrix, terms.get("w")
    if terms.kind == "unified":
        return "omni", "radtan", [*terms.get("xi"), *matrix], terms.get("k1", "k2", "p1", "p2")
    return terms.kind, "none", [*terms.get(*CAMERAS[terms.kind]), *matrix], []


def _list(values: list[float]) -> str:
    return "[" + ", ".join(map(number, values)) + "]"


FORMAT = Format(
    "kalibr",
    "a Kalibr camchain",
    (".yaml",),
    _sniff,
    _read,
    _write,
    MODELS,
    several=True,
    poses=True,
    order="pinhole fu fv pu pv; omni xi fu fv pu pv; eucm alpha beta fu ...; ds xi alpha fu ...; radtan k1 k2 p1 p2; "
    "T_cn_cnm1 takes points of camera n-1 to camera n",
    traps=(
        "radtan has no k3: a camera with k3 is refused or refitted.",
        "omni puts xi first, before the focal lengths; its matrix belongs to the point seen from xi behind the sphere.",
        "A chain holds the pose from the camera before, not from the first.",
    ),
    source="Kalibr, wiki: yaml formats and supported models",
)
