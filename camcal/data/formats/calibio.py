"""calib.io's Calibrator: JSON of libCalib, each parameter as {val, state}; fx = f, fy = f * ar."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from camcal.data.formats.base import CameraFile, Format, NamedCamera, floats, image_size, unknown
from camcal.data.formats.jsonform import dump, has
from camcal.data.formats.opencv import ORDER
from camcal.data.formats.source import Source
from camcal.data.formats.terms import choose, polynomial
from camcal.geometry import rotations
from camcal.model.pose import Pose

KNOWN = ("libCalib::CameraModelOpenCV",)
#: the coefficients by calib.io's names, in OpenCV's order
NAMES = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tauX", "tauY")
MODELS = ("opencv5", "opencv8", "opencv12", "opencv14")
FIRST = 1 << 31


def listed_cameras(source: Source) -> Any:
    """The entries of the cameras; a Calibrator project has them under `calibration`."""
    found = source.mapping if source.kind == "json" else {}
    inner = found.get("Calibration", found.get("calibration", found))
    return inner.get("cameras") if isinstance(inner, Mapping) else None


def size_of(data: Mapping[str, Any]) -> tuple[int, int]:
    """The image size, from the data of a camera model."""
    size = data["CameraModelCRT"]["CameraModelBase"]["imageSize"]
    return image_size(size["width"], size["height"])


def _sniff(source: Source) -> bool:
    listed = listed_cameras(source)
    return isinstance(listed, list) and any(
        has(c, "model") and has(c["model"], "ptr_wrapper") for c in listed
    )


def _read(source: Source) -> CameraFile:
    names: dict[int, str] = {}
    found = []
    for i, entry in enumerate(listed_cameras(source)):
        model = entry["model"]
        identity = int(model.get("polymorphic_id", 0)) & ~FIRST
        names.setdefault(identity, model.get("polymorphic_name"))
        kind = names[identity]
        if kind not in KNOWN:
            raise unknown("calib.io camera model", kind, KNOWN)
        found.append(
            NamedCamera(f"camera{i}", _camera(model["ptr_wrapper"]["data"]), _pose(entry.get("transform")))
        )
    if len(found) == 1:
        return CameraFile((NamedCamera("camera", found[0].camera),))
    return CameraFile(tuple(found))


def _camera(data: Mapping[str, Any]) -> Any:
    given = data["parameters"]

    def value(name: str, default: float | None = None) -> float:
        if name not in given and default is not None:
            return default
        return float(floats(given[name]["val"], 1, name)[0])

    d = [value(n, 0.0) for n in NAMES]
    unread = [n for n in given if n not in (*NAMES, "f", "ar", "cx", "cy") and value(n)]
    if unread:
        raise ValueError(f"the parameters {', '.join(unread)}, which camcal does not know")
    f = value("f")
    matrix = (f, f * value("ar", 1.0), value("cx"), value("cy"), 0.0)
    return polynomial(
        matrix,
        size_of(data),
        [d[0], d[1], d[4]],
        d[2:4],
        denominator=d[5:8],
        prism=d[8:12],
        tilt=d[12:],
    )


def _pose(entry: Mapping[str, Any] | None) -> Pose | None:
    if not entry:
        return None
    r, t = entry["rotation"], entry["translation"]
    return Pose(rotations.exp(floats([r["rx"], r["ry"], r["rz"]])), floats([t["x"], t["y"], t["z"]]))


def _write(cameras: CameraFile, suffix: str) -> str:
    listed = []
    for i, named in enumerate(cameras.cameras):
        _, terms = choose(named.camera, MODELS, "calib.io's JSON")
        values = {"f": terms.fx, "ar": terms.fy / terms.fx, "cx": terms.cx, "cy": terms.cy}
        values |= dict(zip(NAMES, terms.get(*ORDER), strict=True))
        width, height = named.camera.image_size
        data = {
            "parameters": {n: {"val": v, "state": 0} for n, v in values.items()},
            "CameraModelCRT": {"CameraModelBase": {"imageSize": {"width": width, "height": height}}},
        }
        pose = named.pose or Pose.identity()
        vector = rotations.log(pose.rotation).tolist()
        model = {"polymorphic_id": 1 + (FIRST if i == 0 else 0)}
        if i == 0:
            model["polymorphic_name"] = KNOWN[0]  # type: ignore[assignment]
        listed.append(
            {
                "model": {**model, "ptr_wrapper": {"id": i + 1 + FIRST, "data": data}},
                "transform": {
                    "rotation": dict(zip(("rx", "ry", "rz"), vector, strict=True)),
                    "translation": dict(zip("xyz", np.asarray(pose.translation).tolist(), strict=True)),
                },
            }
        )
    return dump({"Calibration": {"cameras": listed}})


FORMAT = Format(
    "calibio",
    "calib.io's JSON",
    (".json",),
    _sniff,
    _read,
    _write,
    MODELS,
    several=True,
    poses=True,
    order="f, ar (fy over fx), cx, cy, then OpenCV's coefficients by name",
    traps=(
        "fy = f * ar.",
        "The direction of `transform` is not documented; it is read and written as x_cam = R x_rig + t.",
        "Other camera models of libCalib are refused by name.",
    ),
    source="calib.io, Calibrator: reading of parameters",
)
