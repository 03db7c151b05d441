"""Meshroom (AliceVision): cameras.sfm, JSON with numbers as text; lengths in mm on the sensor."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from camcal.data.formats.base import CameraFile, Format, NamedCamera, floats, image_size, number, unknown
from camcal.data.formats.jsonform import dump, has
from camcal.data.formats.source import Source
from camcal.data.formats.terms import Terms, choose, fisheye, polynomial
from camcal.errors import DataError

#: since this version of the file the principal point counts from the middle of the image
MIDDLE = (1, 2, 1)
#: mm; the width of the sensor that is written, as the file has focal lengths in mm
SENSOR = 36.0
#: distortionType (of newer files) or type (of older ones) -> number of parameters
KNOWN = {
    "none": 0,
    "pinhole": 0,
    "radialk1": 1,
    "radial1": 1,
    "radialk3": 3,
    "radial3": 3,
    "brown": 5,
    "brownt2": 5,
    "fisheye4": 4,
    "fisheye": 4,
}
MODELS = ("pinhole+square", "brown:radial=3,decentering=0+square", "opencv5+square", "kb4+square")


def _sniff(source: Source) -> bool:
    listed = source.mapping.get("intrinsics") if source.kind == "json" else None
    return isinstance(listed, list) and any(has(i, "intrinsicId", "width") for i in listed)


def _read(source: Source) -> CameraFile:
    version = tuple(int(float(n)) for n in source.mapping.get("version", MIDDLE))
    found = source.mapping["intrinsics"]
    cameras = [NamedCamera(str(c["intrinsicId"]), _camera(c, version >= MIDDLE)) for c in found]
    return CameraFile(
        tuple(cameras), ("the poses of the pictures are left out",) * bool(source.mapping.get("poses"))
    )


def _point(entry: Any) -> list[float]:
    if isinstance(entry, Mapping):
        entry = [entry["x"], entry["y"]]
    return floats([float(n) for n in entry], 2, "principalPoint").tolist()


def _camera(c: Mapping[str, Any], from_middle: bool) -> Any:
    kind = str(c.get("distortionType") or c.get("type", "pinhole"))
    if c.get("type", "pinhole") not in ("pinhole", *KNOWN):
        raise unknown("Meshroom camera type", c["type"], ("pinhole", *KNOWN))
    if kind not in KNOWN:
        raise unknown("Meshroom distortion", kind, KNOWN)
    if float(c.get("pixelRatio", 1)) != 1:
        raise DataError(
            f"a pixelRatio of {c['pixelRatio']}, which programs interpret in two ways.",
            "Export square pixels.",
        )
    size = image_size(c["width"], c["height"])
    if "pxFocalLength" in c:
        given = c["pxFocalLength"]
        f = floats([float(n) for n in (given if isinstance(given, list) else [given])])[0]
    else:
        f = float(c["focalLength"]) / float(c["sensorWidth"]) * size[0]
    cx, cy = _point(c["principalPoint"])
    if from_middle:
        cx, cy = cx + size[0] / 2, cy + size[1] / 2
    words = c.get("distortionParams") or []
    d = floats([float(n) for n in words], None, "distortionParams").tolist()
    d = d if any(d) or len(d) == KNOWN[kind] else [0.0] * KNOWN[kind]
    floats(d, KNOWN[kind], "distortionParams")
    matrix = (f, f, cx, cy, 0.0)
    return fisheye(matrix, size, d) if kind.startswith("fisheye") else polynomial(matrix, size, d[:3], d[3:])


def _kind(terms: Terms) -> tuple[str, list[float]]:
    if terms.kind == "fisheye":
        return "fisheye4", terms.get("k1", "k2", "k3", "k4")
    if any(terms.get("p1", "p2")):
        return "brown", terms.get("k1", "k2", "k3", "p1", "p2")
    return ("radialk3", terms.get("k1", "k2", "k3")) if terms.needed else ("none", [])


def _write(cameras: CameraFile, suffix: str) -> str:
    listed = []
    for i, named in enumerate(cameras.cameras):
        _, terms = choose(named.camera, MODELS, "a Meshroom file")
        kind, d = _kind(terms)
        width, height = named.camera.image_size
        listed.append(
            {
                "intrinsicId": named.name if named.name.isdigit() else str(i),
                "width": str(width),
                "height": str(height),
                "sensorWidth": number(SENSOR),
                "sensorHeight": number(SENSOR * height / width),
                "serialNumber": "",
                "type": "pinhole",
                "initializationMode": "calibrated",
                "initialFocalLength": "-1",
                "focalLength": number(terms.fx * SENSOR / width),
                "pixelRatio": "1",
                "pixelRatioLocked": "true",
                "principalPoint": [number(terms.cx - width / 2), number(terms.cy - height / 2)],
                "distortionType": kind,
                "distortionParams": [number(v) for v in d],
                "locked": "true",
            }
        )
    return dump({"version": ["1", "2", "5"], "intrinsics": listed})


FORMAT = Format(
    "meshroom",
    "a Meshroom file",
    (".sfm", ".json"),
    _sniff,
    _read,
    _write,
    MODELS,
    several=True,
    centre="(0, 0), not stated in the program's documentation",
    order="focalLength in mm of sensorWidth; principalPoint in px from the middle; k1 k2 k3 t1 t2 as OpenCV's",
    traps=(
        "Numbers are stored as text.",
        "Before file version 1.2.1 the principal point is measured from the top-left corner.",
        "A pixelRatio other than 1 is refused: whether focalLength belongs to x or y differs between programs.",
    ),
    source="AliceVision, sfmDataIO and its changelog",
)
