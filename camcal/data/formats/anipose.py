"""Rigs in TOML: anipose, caliscope and Pose2Sim, with poses from the world to the camera.

All three hold OpenCV's matrix and coefficients, or cv2.fisheye's where `fisheye` is true; they differ in the
names of the tables and in how a rotation is written.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from camcal.data.formats.base import (
    CameraFile,
    Format,
    NamedCamera,
    floats,
    image_size,
    matrix_values,
    number,
)
from camcal.data.formats.opencv import ORDER, coefficients
from camcal.data.formats.source import Source
from camcal.data.formats.terms import choose, fisheye, polynomial
from camcal.errors import UsageError
from camcal.geometry import rotations
from camcal.model.pose import Pose

MODELS = ("opencv5", "kb4")


def _tables(source: Source) -> dict[str, Any]:
    found = source.mapping if source.kind == "toml" else {}
    inner = found.get("cameras", found)
    inner = inner if isinstance(inner, Mapping) else found
    return {n: c for n, c in inner.items() if isinstance(c, Mapping) and "matrix" in c}


def _is_caliscope(source: Source) -> bool:
    return "cameras" in source.mapping and bool(_tables(source))


def _is_pose2sim(source: Source) -> bool:
    tables = _tables(source)
    return bool(tables) and "adjusted" in (source.mapping.get("metadata") or {})


def _read(source: Source) -> CameraFile:
    found, notes = [], []
    for key, table in _tables(source).items():
        if table.get("ignore"):
            notes.append(f"camera '{key}' is marked as ignored; it was read anyway")
        found.append(NamedCamera(str(table.get("name", key)), _camera(table), _pose(table)))
    return CameraFile(tuple(found), tuple(notes))


def _camera(table: Mapping[str, Any]) -> Any:
    matrix, size = matrix_values(table["matrix"]), image_size(*floats(table["size"], 2, "size"))
    d = floats(table.get("distortions", []), (0, 1, 2, 4, 5), "distortions").tolist()
    if table.get("fisheye"):
        return fisheye(matrix, size, floats([*d, 0.0, 0.0, 0.0, 0.0][:4]))
    values = dict(zip(ORDER, d, strict=False))
    k = [values.get(n, 0.0) for n in (("k1", "k2", "k3") if len(d) == 5 else ("k1", "k2"))]
    return polynomial(matrix, size, k, [values.get(n, 0.0) for n in ("p1", "p2")])


def _pose(table: Mapping[str, Any]) -> Pose | None:
    if table.get("rotation") is None or table.get("translation") is None:
        return None
    rotation = floats(table["rotation"], (3, 9), "rotation")
    turn = rotations.exp(rotation) if len(rotation) == 3 else rotation.reshape(3, 3)
    return Pose(turn, floats(table["translation"], 3, "translation"))


def text(value: str) -> str:
    """A TOML string."""
    escaped = "".join(c if c.isprintable() and c not in '"\\' else f"\\U{ord(c):08x}" for c in value)
    return f'"{escaped}"'


def _list(values: Any) -> str:
    return "[ " + ", ".join(_list(v) if isinstance(v, list) else number(v) for v in values) + "]"


def _entries(cameras: CameraFile, title: str) -> list[tuple[str, dict[str, str], Pose]]:
    """The name, the TOML entries and the pose of each camera."""
    if len(cameras.cameras) > 1 and not cameras.has_poses:
        raise UsageError(
            f"{title} needs the poses of the cameras; these have none.", "Choose one camera: --camera NAME"
        )
    made = []
    for named in cameras.cameras:
        spec, terms = choose(named.camera, MODELS, title)
        width, height = named.camera.image_size
        entries = {
            "name": text(named.name),
            "size": f"[ {width}, {height}]",
            "matrix": _list(terms.matrix.tolist()),
        }
        entries["distortions"] = _list(coefficients(spec, terms))
        if terms.kind == "fisheye":
            entries["fisheye"] = "true"
        made.append((named.name, entries, named.pose or Pose.identity()))
    return made


def _write(cameras: CameraFile, suffix: str) -> str:
    out = ""
    for i, (_, entries, pose) in enumerate(_entries(cameras, "an anipose calibration")):
        vectors = {"rotation": rotations.log(pose.rotation), "translation": pose.translation}
        out += _table(f"cam_{i}", entries | {n: _list(v.tolist()) for n, v in vectors.items()})
    return out + "[metadata]\n"


def _write_pose2sim(cameras: CameraFile, suffix: str) -> str:
    out = ""
    for i, (_, entries, pose) in enumerate(_entries(cameras, "a Pose2Sim calibration"), 1):
        if "fisheye" not in entries and not entries["distortions"].endswith(" 0.0]"):
            raise UsageError(
                "a Pose2Sim calibration cannot hold k3: it has four coefficients.",
                "Refit it: --to-model opencv4",
            )
        entries.setdefault("fisheye", "false")
        if entries["fisheye"] == "false":
            entries["distortions"] = entries["distortions"].rpartition(",")[0] + "]"
        vectors = {"rotation": rotations.log(pose.rotation), "translation": pose.translation}
        out += _table(f"cam_{i:02d}", entries | {n: _list(v.tolist()) for n, v in vectors.items()})
    return out + "[metadata]\nadjusted = false\nerror = 0.0\n"


def _write_caliscope(cameras: CameraFile, suffix: str) -> str:
    out = ""
    for i, (name, entries, pose) in enumerate(_entries(cameras, "a caliscope camera array")):
        key = name if name.isdigit() else text(name)
        own = {k: v for k, v in entries.items() if k != "name"}
        own |= {"cam_id": name if name.isdigit() else str(i), "rotation_count": "0", "ignore": "false"}
        own |= {"rotation": _list(pose.rotation.tolist()), "translation": _list(pose.translation.tolist())}
        out += _table(f"cameras.{key}", own)
    return out


def _table(name: str, entries: Mapping[str, str]) -> str:
    return f"[{name}]\n" + "".join(f"{n} = {v}\n" for n, v in entries.items()) + "\n"


_COMMON: dict[str, Any] = {"several": True, "poses": True}
_ORDER = "matrix; distortions k1 k2 p1 p2 [k3], or cv2.fisheye's where fisheye is true; x_cam = R x_world + t"
FORMAT = Format(
    "anipose",
    "an anipose calibration",
    (".toml",),
    lambda source: bool(_tables(source)),
    _read,
    _write,
    MODELS,
    **_COMMON,
    order=_ORDER + ", R as a rotation vector",
    traps=(
        "The translations are in the unit of the board used in the calibration, which the file does not state.",
    ),
    source="anipose, aniposelib.cameras",
)
CALISCOPE = Format(
    "caliscope",
    "a caliscope camera array",
    (".toml",),
    _is_caliscope,
    _read,
    _write_caliscope,
    MODELS,
    **_COMMON,
    order=_ORDER + ", R as a matrix (a rotation vector in newer files)",
    traps=("Older files call the camera cam_id or port; here the name of the table is used.",),
    source="caliscope, camera_array.toml",
)
POSE2SIM = Format(
    "pose2sim",
    "a Pose2Sim calibration",
    (".toml",),
    _is_pose2sim,
    _read,
    _write_pose2sim,
    ("opencv4", "kb4"),
    **_COMMON,
    order=_ORDER + ", R as a rotation vector; metres",
    traps=("It has four coefficients: k3 is refused or refitted.",),
    source="Pose2Sim, calibration",
)
