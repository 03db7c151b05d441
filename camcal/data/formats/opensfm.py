"""OpenSfM and ODM: reconstruction.json, camera_models.json and cameras.json.

Lengths are in units of the longer side of the image; the centre of the image, ((w - 1) / 2, (h - 1) / 2) with
(0, 0) as the centre of the top-left pixel, is the origin.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from camcal.data.formats.base import CameraFile, Format, NamedCamera, floats, image_size, unknown
from camcal.data.formats.colmap import rad_tan_thin_prism
from camcal.data.formats.foreign import at_angle, foreign_camera
from camcal.data.formats.jsonform import dump, has
from camcal.data.formats.source import Source
from camcal.data.formats.terms import Terms, choose, fisheye, polynomial

#: projection type -> names of its distortion parameters, in this module's order
KNOWN = {
    "perspective": ("k1", "k2"),
    "simple_radial": ("k1",),
    "radial": ("k1", "k2"),
    "brown": ("k1", "k2", "k3", "p1", "p2"),
    "fisheye": ("k1", "k2"),
    "fisheye_opencv": ("k1", "k2", "k3", "k4"),
    "fisheye62": ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"),
    "fisheye624": ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2", "s0", "s1", "s2", "s3"),
}
MODELS = ("opencv5", "kb4", "kb:6")


def _cameras(source: Source) -> Mapping[str, Any]:
    """The mapping of cameras: from the first reconstruction, from `cameras`, or the file itself."""
    found = source.tree
    if isinstance(found, list):
        found = found[0] if found else {}
    if not isinstance(found, Mapping):
        return {}
    inner = found.get("cameras", found)
    return inner if isinstance(inner, Mapping) else {}


def _sniff(source: Source) -> bool:
    return source.kind == "json" and any(has(c, "projection_type") for c in _cameras(source).values())


def _read(source: Source) -> CameraFile:
    cameras = tuple(NamedCamera(n, _camera(c)) for n, c in _cameras(source).items())
    shots = isinstance(source.tree, list) and has(source.tree[0], "shots")
    return CameraFile(cameras, ("the poses of the pictures (shots) are left out",) * shots)


def _camera(found: Mapping[str, Any]) -> Any:
    kind = found["projection_type"]
    if kind not in KNOWN:
        raise unknown("projection_type", kind, KNOWN)
    size = image_size(found["width"], found["height"])
    n = max(size)
    fx, fy = found.get("focal_x", found.get("focal")), found.get("focal_y", found.get("focal"))
    fx, fy, cx, cy = floats([fx, fy, found.get("c_x", 0.0), found.get("c_y", 0.0)]) * n
    matrix = (fx, fy, cx + (size[0] - 1) / 2, cy + (size[1] - 1) / 2, 0.0)
    d = dict(zip(KNOWN[kind], floats([found.get(name, 0.0) for name in KNOWN[kind]]).tolist(), strict=True))
    k = [d[name] for name in d if name[0] == "k"]
    if not kind.startswith("fisheye"):
        return polynomial(matrix, size, k, [d[name] for name in ("p1", "p2") if name in d])
    rest = [v for name, v in d.items() if name[0] != "k"]
    if not any(rest):
        return fisheye(matrix, size, k)
    forward = rad_tan_thin_prism([*k, *rest, 0.0, 0.0, 0.0, 0.0][:12])
    reason = "camcal has no decentering or thin-prism terms for a fisheye lens"
    return foreign_camera(f"OpenSfM's {kind}", reason, matrix, size, forward, at_angle)


def _write(cameras: CameraFile, suffix: str) -> str:
    return dump({c.name: _entry(c.camera) for c in cameras.cameras})


def _entry(camera: Any) -> dict[str, Any]:
    _, terms = choose(camera, MODELS, "OpenSfM's JSON")
    kind = _kind(terms)
    width, height = camera.image_size
    n = max(width, height)
    made: dict[str, Any] = {"projection_type": kind, "width": width, "height": height}
    made |= {"focal_x": terms.fx / n, "focal_y": terms.fy / n}
    made |= {"c_x": (terms.cx - (width - 1) / 2) / n, "c_y": (terms.cy - (height - 1) / 2) / n}
    names = KNOWN[kind]
    return made | dict(zip(names, terms.get(*names), strict=True))


def _kind(terms: Terms) -> str:
    if terms.kind == "polynomial":
        return "brown"
    return "fisheye62" if any(terms.get("k5", "k6")) else "fisheye_opencv"


FORMAT = Format(
    "opensfm",
    "OpenSfM's JSON",
    (".json",),
    _sniff,
    _read,
    _write,
    MODELS,
    several=True,
    centre="(-(w - 1)/2, -(h - 1)/2), in the longer side",
    order="focal (or focal_x focal_y, c_x c_y) over max(width, height); k1 k2 k3 p1 p2 as OpenCV's",
    traps=(
        "The unit is the longer side of the image, also for the vertical direction.",
        "fisheye62 and fisheye624 with decentering have no counterpart in camcal: they are refitted.",
        "ODM's cameras.json has the same entries.",
    ),
    source="OpenSfM, documentation (camera models), opensfm/types",
)
