"""Qualisys Track Manager: the XML of a camera calibration (.qca.txt). Lengths on the sensor are in 1/64 px."""

from __future__ import annotations

from typing import Any
from xml.etree.ElementTree import Element
from xml.sax.saxutils import quoteattr

import numpy as np

from camcal.data.formats.base import CameraFile, Format, NamedCamera, floats, image_size, number
from camcal.data.formats.source import Source
from camcal.data.formats.terms import choose, polynomial
from camcal.data.formats.xmlform import header
from camcal.model.pose import Pose

STEPS = 64  #: of a pixel
#: QTM's camera has y up and looks along -z
AXES = np.diag([1.0, -1.0, -1.0])
MODELS = ("opencv5+skew",)
NOTE = "QTM does not document the direction of its distortion; it is read as OpenCV's, from the scene to the image"


def _sniff(source: Source) -> bool:
    root = source.xml
    return root is not None and root.find("cameras/camera/intrinsic") is not None


def _read(source: Source) -> CameraFile:
    cameras, bent = [], False
    for i, entry in enumerate(source.root.iter("camera")):
        name = str(entry.get("serial") or i)
        camera = _camera(entry)
        bent = bent or any(camera.params[4:])
        cameras.append(NamedCamera(name, camera, _pose(entry.find("transform"))))
    return CameraFile(tuple(cameras), (NOTE,) * bent)


def _numbers(element: Element, *names: str) -> list[float]:
    return floats([float(element.attrib[n]) for n in names]).tolist()


def _camera(entry: Element) -> Any:
    found = entry.find("intrinsic")
    if found is None:
        raise KeyError("intrinsic")
    u0, u1, v0, v1 = _numbers(found, "sensorMinU", "sensorMaxU", "sensorMinV", "sensorMaxV")
    size = image_size((u1 - u0 + 1) / STEPS, (v1 - v0 + 1) / STEPS)
    fx, fy, cx, cy, skew = (
        v / STEPS
        for v in _numbers(found, "focalLengthU", "focalLengthV", "centerPointU", "centerPointV", "skew")
    )
    k = _numbers(found, "radialDistortion1", "radialDistortion2", "radialDistortion3")
    p = _numbers(found, "tangentalDistortion1", "tangentalDistortion2")
    return polynomial((fx, fy, cx - u0 / STEPS, cy - v0 / STEPS, skew), size, k, p)


def _pose(transform: Element | None) -> Pose | None:
    if transform is None:
        return None
    turn = np.array(_numbers(transform, *(f"r{i}{j}" for i in "123" for j in "123"))).reshape(3, 3)
    rotation = AXES @ turn
    return Pose(rotation, -rotation @ np.array(_numbers(transform, "x", "y", "z")))


def _write(cameras: CameraFile, suffix: str) -> str:
    lines = ["<calibration>", "  <cameras>"]
    for named in cameras.cameras:
        _, terms = choose(named.camera, MODELS, "a Qualisys file")
        width, height = named.camera.image_size
        pose = named.pose or Pose.identity()
        turn, centre = AXES @ pose.rotation, pose.centre
        place = dict(zip("xyz", centre.tolist(), strict=True))
        place |= {f"r{i + 1}{j + 1}": float(turn[i, j]) for i in range(3) for j in range(3)}
        k1, k2, k3, p1, p2 = terms.get("k1", "k2", "k3", "p1", "p2")
        own = {
            "sensorMinU": 0,
            "sensorMaxU": width * STEPS - 1,
            "sensorMinV": 0,
            "sensorMaxV": height * STEPS - 1,
            "focalLengthU": terms.fx * STEPS,
            "focalLengthV": terms.fy * STEPS,
            "centerPointU": terms.cx * STEPS,
            "centerPointV": terms.cy * STEPS,
            "skew": terms.skew * STEPS,
            "radialDistortion1": k1,
            "radialDistortion2": k2,
            "radialDistortion3": k3,
            "tangentalDistortion1": p1,
            "tangentalDistortion2": p2,
        }
        lines.append(
            f'    <camera active="1" calibrated="true" serial={quoteattr(named.name)} viewrotation="0">'
        )
        lines.append(f'      <fov_video left="0" top="0" right="{width - 1}" bottom="{height - 1}"/>')
        lines += [f"      <{tag} {_attributes(v)}/>" for tag, v in (("transform", place), ("intrinsic", own))]
        lines.append("    </camera>")
    return header() + "\n".join([*lines, "  </cameras>", "</calibration>"]) + "\n"


def _attributes(values: dict[str, float]) -> str:
    return " ".join(f'{n}="{number(v)}"' for n, v in values.items())


FORMAT = Format(
    "qualisys",
    "a Qualisys file",
    (".txt", ".xml"),
    _sniff,
    _read,
    _write,
    MODELS,
    several=True,
    poses=True,
    centre="(0, 0), not stated in the program's documentation",
    order="focalLengthU/V, centerPointU/V, skew in 1/64 px; distortion without a unit; position in mm and r11 to r33",
    traps=(
        "Lengths on the sensor are in 1/64 px; the distortion coefficients are not.",
        "The camera's axes have y up and look along -z.",
        "The transform holds the position of the camera and the rotation from the world to the camera's axes.",
        NOTE + ".",
    ),
    source="Qualisys Track Manager, real-time protocol, camera calibration",
)
