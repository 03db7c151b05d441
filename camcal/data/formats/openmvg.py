"""OpenMVG: the intrinsics in sfm_data.json."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from camcal.data.formats.base import CameraFile, Format, NamedCamera, floats, image_size, unknown
from camcal.data.formats.jsonform import dump, has
from camcal.data.formats.source import Source
from camcal.data.formats.terms import Terms, choose, fisheye, polynomial

#: cereal's name -> the key of its distortion and how many numbers it has
KNOWN = {
    "pinhole": ("", 0),
    "pinhole_radial_k1": ("disto_k1", 1),
    "pinhole_radial_k3": ("disto_k3", 3),
    "pinhole_brown_t2": ("disto_t2", 5),
    "fisheye": ("fisheye", 4),
}
MODELS = ("pinhole+square", "opencv5+square", "kb4+square")
#: cereal marks the first of a kind with this bit and gives its name there only
FIRST = 1 << 31


def _sniff(source: Source) -> bool:
    found = source.mapping if source.kind == "json" else {}
    listed = found.get("intrinsics")
    return isinstance(listed, list) and any(
        has(i, "value") and has(i["value"], "ptr_wrapper") for i in listed
    )


def _read(source: Source) -> CameraFile:
    names: dict[int, str] = {}
    cameras: list[NamedCamera] = []
    for entry in source.mapping["intrinsics"]:
        value = entry["value"]
        identity = int(value["polymorphic_id"])
        if "polymorphic_name" in value:
            names[identity & ~FIRST] = value["polymorphic_name"]
        kind = names[identity & ~FIRST]
        cameras.append(
            NamedCamera(str(entry.get("key", len(cameras))), _camera(kind, value["ptr_wrapper"]["data"]))
        )
    return CameraFile(tuple(cameras))


def _camera(kind: str, found: Mapping[str, Any]) -> Any:
    if kind not in KNOWN:
        raise unknown("OpenMVG camera", kind, KNOWN)
    found = {**found, **found.get("value0", {})} if isinstance(found.get("value0"), Mapping) else found
    size = image_size(found["width"], found["height"])
    f = float(found["focal_length"])
    matrix = (f, f, *floats(found["principal_point"], 2, "principal_point"), 0.0)
    key, count = KNOWN[kind]
    d = floats(found[key], count, key).tolist() if key else []
    return fisheye(matrix, size, d) if kind == "fisheye" else polynomial(matrix, size, d[:3], d[3:])


def _kind(terms: Terms) -> tuple[str, list[float]]:
    if terms.kind == "fisheye":
        return "fisheye", terms.get("k1", "k2", "k3", "k4")
    if not terms.needed:
        return "pinhole", []
    if any(terms.get("p1", "p2")):
        return "pinhole_brown_t2", terms.get("k1", "k2", "k3", "p1", "p2")
    return "pinhole_radial_k3", terms.get("k1", "k2", "k3")


def _write(cameras: CameraFile, suffix: str) -> str:
    ids: dict[str, int] = {}
    listed = []
    for i, named in enumerate(cameras.cameras):
        _, terms = choose(named.camera, MODELS, "OpenMVG's JSON")
        kind, d = _kind(terms)
        width, height = named.camera.image_size
        data: dict[str, Any] = {"width": width, "height": height, "focal_length": terms.fx}
        data["principal_point"] = [terms.cx, terms.cy]
        if d:
            data[KNOWN[kind][0]] = d
        first = kind not in ids
        ids.setdefault(kind, len(ids) + 1)
        value: dict[str, Any] = {"polymorphic_id": ids[kind] + (FIRST if first else 0)}
        if first:
            value["polymorphic_name"] = kind
        value["ptr_wrapper"] = {"id": i + 1 + FIRST, "data": data}
        listed.append({"key": int(named.name) if named.name.isdigit() else i, "value": value})
    return dump(
        {
            "sfm_data_version": "0.3",
            "root_path": "",
            "views": [],
            "intrinsics": listed,
            "extrinsics": [],
            "structure": [],
            "control_points": [],
        }
    )


FORMAT = Format(
    "openmvg",
    "OpenMVG's JSON",
    (".json",),
    _sniff,
    _read,
    _write,
    MODELS,
    several=True,
    centre="(0, 0), not stated in the program's documentation",
    order="focal_length, principal_point; disto_k3 k1 k2 k3; disto_t2 k1 k2 k3 t1 t2 as OpenCV's p1 p2",
    traps=(
        "It has one focal length: fx different from fy is refused.",
        "The pixel convention is disputed (openMVG issues 1271 and 2180); camcal assumes that pixel "
        "centres are integers.",
        "cereal names a type of camera at its first occurrence only.",
    ),
    source="OpenMVG, src/openMVG/cameras",
)
