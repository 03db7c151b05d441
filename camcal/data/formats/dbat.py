"""DBAT (with PhotoModeler's numbers): millimetres, and Brown's series from the picture to the scene.

x = (pp_x - u)..., in mm: ideal = d (1 + K1 r² + K2 r⁴ + K3 r⁶) + decentering, d = pixel * pixel size - pp.
"""

from __future__ import annotations

from xml.etree.ElementTree import Element

import numpy as np

from camcal.data.formats.base import Array, CameraFile, Format, NamedCamera, floats, image_size, number
from camcal.data.formats.foreign import backward_camera
from camcal.data.formats.source import Source
from camcal.data.formats.terms import choose, polynomial
from camcal.data.formats.xmlform import header
from camcal.errors import DataError

HALF = 0.5
#: mm; the pixel of a file is written with this size, as the focal length in mm is not known
PIXEL = 0.005
MODELS = ("pinhole",)


def _sniff(source: Source) -> bool:
    root = source.xml
    return root is not None and root.tag == "document" and "dbat_camera_version" in root.attrib


def _read(source: Source) -> CameraFile:
    root = source.root
    cameras = [
        NamedCamera((c.findtext("name") or f"camera{i}").strip(), _camera(c))
        for i, c in enumerate(root.iter("camera"), 1)
    ]
    return CameraFile(tuple(cameras))


def _numbers(c: Element, name: str, default: str = "0") -> Array:
    return floats([float(w) for w in (c.findtext(name) or default).split(",")], None, name)


def _camera(c: Element) -> object:
    size = image_size(*_numbers(c, "image", ""))
    f, pp = _numbers(c, "cc"), _numbers(c, "pp", "0,0")
    if f[0] <= 0 or len(pp) != 2:
        raise DataError(
            "the camera is not calibrated: its cc is 0.",
            "Calibrate it in DBAT first, or enter its parameters.",
        )
    aspect, skew = float(_numbers(c, "aspect", "1")[0]), float(_numbers(c, "skew")[0])
    words = [w.strip() for w in (c.findtext("sensor") or "").split(",")]
    if len(words) != 2:
        raise ValueError("the size of the sensor is not two numbers")
    height = float(words[1])
    width = height * size[0] / size[1] * aspect if words[0] == "auto" else float(words[0])
    px, py = width / size[0], height / size[1]
    if not (px > 0 and py > 0):
        raise ValueError("the size of the sensor is not positive")
    if skew:
        raise DataError(
            "it has a skew, whose definition in DBAT camcal does not know.", "Calibrate without skew."
        )
    matrix = (f[0] / px, f[0] / py, pp[0] / px - HALF, pp[1] / py - HALF, 0.0)
    k, p = _numbers(c, "K"), np.r_[_numbers(c, "P"), 0.0, 0.0][:2]
    if not k.any() and not p.any():
        return polynomial(matrix, size)

    def undistort(w: Array) -> Array:
        x, y = w.T * f[0]
        r2 = x * x + y * y
        radial = sum(q * r2 ** (i + 1) for i, q in enumerate(k.tolist()))
        bent_x = x + x * radial + p[0] * (r2 + 2 * x * x) + 2 * p[1] * x * y
        bent_y = y + y * radial + 2 * p[0] * x * y + p[1] * (r2 + 2 * y * y)
        return np.c_[bent_x, bent_y] / f[0]

    reason = "K1, K2, ... are defined from the image to the scene (backward), camcal's series in the other direction"
    return backward_camera("DBAT's lens distortion", reason, matrix, size, undistort)


def _write(cameras: CameraFile, suffix: str) -> str:
    lines = ['<document dbat_camera_version="1.0">', "  <cameras>"]
    for i, named in enumerate(cameras.cameras, 1):
        _, terms = choose(
            named.camera, MODELS, "a DBAT file, whose series is defined from the image to the scene,"
        )
        width, height = named.camera.image_size
        f = terms.fx * PIXEL
        down = f / terms.fy
        values = {
            "id": str(i),
            "name": named.name.replace("&", "and").replace("<", ""),
            "unit": "mm",
            "calibrated": "yes",
            "sensor": f"{number(width * PIXEL)},{number(height * down)}",
            "image": f"{width},{height}",
            "aspect": number(down / PIXEL),
            "focal": number(f),
            "model": "3",
            "nK": "3",
            "nP": "2",
            "cc": number(f),
            "pp": f"{number((terms.cx + HALF) * PIXEL)},{number((terms.cy + HALF) * down)}",
            "skew": "0",
            "K": "0,0,0",
            "P": "0,0",
        }
        lines += ["    <camera>", *(f"      <{n}>{v}</{n}>" for n, v in values.items()), "    </camera>"]
    return header() + "\n".join([*lines, "  </cameras>", "</document>"]) + "\n"


FORMAT = Format(
    "dbat",
    "a DBAT file",
    (".xml",),
    _sniff,
    _read,
    _write,
    MODELS,
    several=True,
    centre="(0.5, 0.5), from the corner of the sensor",
    order="cc, pp in mm; K1 K2 K3 and P1 P2 in powers of mm, from the image to the scene",
    traps=(
        "K and P correct image points (backward): a camera that has them has no exact counterpart and is refitted.",
        "A file with cc = 0 is not calibrated and is refused.",
        "Only cameras without distortion are written, with pixels of 0.005 mm: the file does not state "
        "the pixel size.",
    ),
    source="DBAT, res_euler_brown_3; PhotoModeler's camera files",
)
