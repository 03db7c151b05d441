"""COLMAP's cameras.txt and cameras.bin, with rigs.txt in the same folder.

The centre of the top-left pixel is (0.5, 0.5). Parameters: COLMAP, src/colmap/sensor/models.h.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

import numpy as np

from camcal.data.formats.base import (
    Array,
    CameraFile,
    Format,
    NamedCamera,
    Written,
    floats,
    image_size,
    number,
    unknown,
)
from camcal.data.formats.foreign import at_angle, foreign_camera
from camcal.data.formats.source import Source
from camcal.data.formats.terms import Terms, camera_of, choose, fisheye, polynomial
from camcal.errors import DataError
from camcal.geometry import rotations
from camcal.model.pose import Pose

HALF = 0.5
#: cameras of a binary file: the first eight bytes of any other file are a larger number or 0
MOST_CAMERAS = 10**6
#: model -> (id, number of parameters, whether it has one focal length)
KNOWN = {
    "SIMPLE_PINHOLE": (0, 3, True),
    "PINHOLE": (1, 4, False),
    "SIMPLE_RADIAL": (2, 4, True),
    "RADIAL": (3, 5, True),
    "OPENCV": (4, 8, False),
    "OPENCV_FISHEYE": (5, 8, False),
    "FULL_OPENCV": (6, 12, False),
    "FOV": (7, 5, False),
    "SIMPLE_RADIAL_FISHEYE": (8, 4, True),
    "RADIAL_FISHEYE": (9, 5, True),
    "THIN_PRISM_FISHEYE": (10, 12, False),
    "RAD_TAN_THIN_PRISM_FISHEYE": (11, 16, False),
    "SIMPLE_DIVISION": (12, 4, True),
    "DIVISION": (13, 5, False),
}
BY_ID = {v[0]: k for k, v in KNOWN.items()}
#: camcal's model -> COLMAP's and its terms in COLMAP's order, the simplest first
WRITES = {
    "pinhole+square": ("SIMPLE_PINHOLE", ()),
    "pinhole": ("PINHOLE", ()),
    "brown:radial=1,decentering=0+square": ("SIMPLE_RADIAL", ("k1",)),
    "brown:radial=2,decentering=0+square": ("RADIAL", ("k1", "k2")),
    "opencv4": ("OPENCV", ("k1", "k2", "p1", "p2")),
    "opencv8": ("FULL_OPENCV", ("k1", "k2", "p1", "p2", "k3", "d1", "d2", "d3")),
    "fov": ("FOV", ("w",)),
    "kb:1+square": ("SIMPLE_RADIAL_FISHEYE", ("k1",)),
    "kb:2+square": ("RADIAL_FISHEYE", ("k1", "k2")),
    "kb4": ("OPENCV_FISHEYE", ("k1", "k2", "k3", "k4")),
    "division:1+square": ("SIMPLE_DIVISION", ("l1",)),
    "division:1": ("DIVISION", ("l1",)),
}
MODELS = tuple(WRITES)
Size = tuple[int, int]


def _sniff(source: Source) -> bool:
    if source.kind == "text":
        lines = _lines(source.text or "")
        words = lines[0].split() if lines else []
        return len(words) >= 6 and words[1].isupper() and all(words[i].isdigit() for i in (0, 2, 3))
    if source.kind != "binary" or len(source.data) < 56:
        return False
    count, _, model = struct.unpack_from("<Qii", source.data)
    return 0 < count < MOST_CAMERAS and model in BY_ID


def _lines(text: str) -> list[str]:
    return [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]


def _read(source: Source) -> CameraFile:
    listed = _of_binary(source.data) if source.kind == "binary" else _of_text(source.text or "")
    poses, notes = _rigs(source)
    cameras = [NamedCamera(str(i), _camera(m, s, p), poses.get(i)) for i, m, s, p in listed]
    return CameraFile(tuple(cameras), notes)


def _of_text(text: str) -> list[tuple[int, str, Size, list[float]]]:
    found = []
    for line in _lines(text):
        words = line.split()
        if words[1] not in KNOWN:
            raise unknown("COLMAP model", words[1], KNOWN)
        values = floats(words[4:], KNOWN[words[1]][1], f"camera {words[0]} ({words[1]})").tolist()
        found.append((int(words[0]), words[1], image_size(words[2], words[3]), values))
    return found


def _of_binary(data: bytes) -> list[tuple[int, str, Size, list[float]]]:
    found: list[tuple[int, str, Size, list[float]]] = []
    count, at = struct.unpack_from("<Q", data)[0], 8
    for _ in range(count):
        if at + 24 > len(data):
            raise DataError(f"it ends after {len(found)} of {count} cameras.", "Is it complete?")
        number_, model, width, height = struct.unpack_from("<iiQQ", data, at)
        if model not in BY_ID:
            raise unknown("COLMAP model id", model, map(str, BY_ID))
        name = BY_ID[model]
        length = KNOWN[name][1]
        if at + 24 + 8 * length > len(data):
            raise DataError(f"it ends within camera {number_}.", "Is it complete?")
        values = floats(struct.unpack_from(f"<{length}d", data, at + 24)).tolist()
        found.append((number_, name, image_size(width, height), values))
        at += 24 + 8 * length
    return found


def _rigs(source: Source) -> tuple[dict[int, Pose], tuple[str, ...]]:
    """cam_from_rig by camera id, if rigs.txt in the same folder describes one rig."""
    beside = source.neighbour("rigs.txt")
    if beside is None or beside.kind != "text":
        return {}, ()
    rigs = [_rig(line.split()) for line in _lines(beside.text or "")]
    rigs = [r for r in rigs if len(r) > 1]
    if len(rigs) > 1:
        return {}, (f"rigs.txt holds {len(rigs)} rigs; their poses are left out",)
    return (rigs[0] if rigs else {}), ()


def _rig(words: list[str]) -> dict[int, Pose]:
    """RIG_ID NUM_SENSORS REF_TYPE REF_ID, then TYPE ID HAS_POSE [QW QX QY QZ TX TY TZ] of each other sensor."""
    found = {int(words[3]): Pose.identity()} if len(words) > 3 and words[2] == "CAMERA" else {}
    at = 4
    while at + 2 < len(words):
        kind, sensor, has = words[at : at + 3]
        at += 3
        if has == "1":
            values = floats(words[at : at + 7], 7, "a pose of rigs.txt")
            at += 7
            if kind == "CAMERA":
                found[int(sensor)] = Pose(of_quaternion(values[:4]), values[4:])
    return found


def of_quaternion(q: Array) -> Array:
    """The rotation matrix of a quaternion w, x, y, z of any length but 0."""
    n = float(np.linalg.norm(q))
    if n == 0:
        raise ValueError("a quaternion of length 0")
    w, v = q[0] / n, q[1:] / n
    k = rotations.skew(v)
    return np.eye(3) + 2 * w * k + 2 * k @ k


def to_quaternion(rotation: Array) -> Array:
    """The quaternion w, x, y, z of a rotation matrix, w >= 0."""
    vector = rotations.log(rotation)
    angle = float(np.linalg.norm(vector))
    return np.r_[np.cos(angle / 2), 0.5 * np.sinc(angle / (2 * np.pi)) * vector]


def _camera(model: str, size: Size, p: list[float]) -> Any:
    one = KNOWN[model][2]
    fx, fy, cx, cy, *d = [p[0], *p] if one else p
    matrix = (fx, fy, cx - HALF, cy - HALF, 0.0)
    if model == "FOV":
        return camera_of("fov", matrix, size, {"w": d[0]})
    if model in ("SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "OPENCV_FISHEYE"):
        return fisheye(matrix, size, d)
    if model.endswith("DIVISION"):
        return camera_of("division:1", matrix, size, {"l1": d[0]})
    if model in ("THIN_PRISM_FISHEYE", "RAD_TAN_THIN_PRISM_FISHEYE"):
        forward = _thin_prism(d) if model[0] == "T" else rad_tan_thin_prism(d)
        reason = "camcal has no decentering or thin-prism terms for a fisheye lens"
        return foreign_camera(f"COLMAP's {model}", reason, matrix, size, forward, at_angle)
    return polynomial(matrix, size, [*d[:2], *d[4:5]], d[2:4], denominator=d[5:8])


def _thin_prism(d: list[float]) -> Callable[[Array], Array]:
    k1, k2, p1, p2, k3, k4, sx, sy = d

    def forward(w: Array) -> Array:
        x, y = w.T
        r2 = x * x + y * y
        f = 1 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)))
        return np.c_[
            x * f + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) + sx * r2,
            y * f + 2 * p2 * x * y + p1 * (r2 + 2 * y * y) + sy * r2,
        ]

    return forward


def rad_tan_thin_prism(d: list[float]) -> Callable[[Array], Array]:
    """k1 to k6 of the angle, then p0, p1 and s0 to s3 of the point (N, 2), as in Project Aria."""
    k, (p0, p1, s0, s1, s2, s3) = d[:6], d[6:]

    def forward(w: Array) -> Array:
        t2 = (w * w).sum(1)
        x, y = (w * (1 + sum(c * t2 ** (i + 1) for i, c in enumerate(k)))[:, None]).T
        r2 = x * x + y * y
        along = 2 * (x * p0 + y * p1)
        return np.c_[
            x + along * x + r2 * p0 + s0 * r2 + s1 * r2 * r2,
            y + along * y + r2 * p1 + s2 * r2 + s3 * r2 * r2,
        ]

    return forward


def _write(cameras: CameraFile, suffix: str) -> Written:
    ids = _ids(cameras.names)
    listed = []
    for i, named in zip(ids, cameras.cameras, strict=True):
        text, terms = choose(named.camera, MODELS, "a COLMAP file")
        model, names = WRITES[text]
        listed.append((i, model, named.camera.image_size, _parameters(model, names, terms)))
    rigs = {}
    if len(ids) > 1 and cameras.has_poses:
        rigs["rigs.txt"] = _rig_text(ids, cameras)
    if suffix == ".bin":
        data = struct.pack("<Q", len(listed))
        for i, model, (width, height), values in listed:
            data += struct.pack(f"<iiQQ{len(values)}d", i, KNOWN[model][0], width, height, *values)
        return Written(data, rigs)
    head = "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"
    lines = [f"{i} {m} {w} {h} {' '.join(map(number, v))}\n" for i, m, (w, h), v in listed]
    return Written(head + f"# Number of cameras: {len(listed)}\n" + "".join(lines), rigs)


def _ids(names: list[str]) -> list[int]:
    """Camera ids: the names if they are whole numbers above 0, otherwise 1, 2, ..."""
    own = [int(n) if n.isdigit() and 0 < int(n) < 2**31 else 0 for n in names]
    return own if 0 not in own and len(set(own)) == len(own) else list(range(1, len(names) + 1))


def _parameters(model: str, names: tuple[str, ...], terms: Terms) -> list[float]:
    focal = [terms.fx] if KNOWN[model][2] else [terms.fx, terms.fy]
    return [*focal, terms.cx + HALF, terms.cy + HALF, *terms.get(*names)]


def _rig_text(ids: list[int], cameras: CameraFile) -> str:
    first = cameras.cameras[0].pose
    assert first is not None
    words = ["1", str(len(ids)), "CAMERA", str(ids[0])]
    for i, named in zip(ids[1:], cameras.cameras[1:], strict=True):
        assert named.pose is not None
        pose = named.pose @ first.inverse()
        words += ["CAMERA", str(i), "1", *map(number, [*to_quaternion(pose.rotation), *pose.translation])]
    head = (
        "# Rig calib list with one line of data per calib:\n#   RIG_ID, NUM_SENSORS, REF_SENSOR_TYPE, REF_SENSOR_ID, "
        "SENSORS[] as (SENSOR_TYPE, SENSOR_ID, HAS_POSE, [QW, QX, QY, QZ, TX, TY, TZ])\n"
    )
    return head + f"# Number of rigs: 1\n{' '.join(words)}\n"


FORMAT = Format(
    "colmap",
    "a COLMAP file",
    (".txt", ".bin"),
    _sniff,
    _read,
    _write,
    MODELS,
    several=True,
    poses=True,
    centre="(0.5, 0.5)",
    order="f or fx fy, cx cy, then OpenCV's order; rigs.txt: quaternion w x y z and translation, sensor_from_rig",
    traps=(
        "The principal point is half a pixel larger than OpenCV's.",
        "Without rigs.txt, a file of several cameras has no relative poses.",
        "FOV and the fisheye models are functions of the angle: `FOV` is the model of Devernay and "
        "Faugeras, with w in rad.",
        "THIN_PRISM_FISHEYE and RAD_TAN_THIN_PRISM_FISHEYE have no counterpart here: they are refitted.",
    ),
    source="COLMAP, documentation (cameras, output format, FAQ) and src/colmap/sensor/models.h",
)
