"""ViSP: vpCameraParameters as vpXmlParserCamera writes them. Scene to picture: u = u0 + px x (1 + kud r²)."""

from __future__ import annotations

from xml.etree.ElementTree import Element
from xml.sax.saxutils import escape

import numpy as np

from camcal.data.formats.base import CameraFile, Format, NamedCamera, image_size, number, unknown
from camcal.data.formats.source import Source
from camcal.data.formats.terms import Terms, choose, polynomial
from camcal.data.formats.xmlform import header, one
from camcal.errors import DataError

PLAIN, BENT = "perspectiveProjWithoutDistortion", "perspectiveProjWithDistortion"
MODELS = ("brown:radial=1,decentering=0",)
#: points of the fit of kdu, ViSP's own approximation of the other direction
FIT = 200


def _sniff(source: Source) -> bool:
    root = source.xml
    return root is not None and root.find("camera/model/px") is not None


def _read(source: Source) -> CameraFile:
    root = source.root
    cameras = []
    for entry in root.findall("camera"):
        name = (entry.findtext("name") or "camera").strip()
        cameras.append(NamedCamera(name, _camera(entry)))
    return CameraFile(tuple(cameras))


def _camera(entry: Element) -> object:
    models = {(m.findtext("type") or "").strip(): m for m in entry.findall("model")}
    for kind in models:
        if kind not in (PLAIN, BENT):
            raise unknown("ViSP projection model", kind, (PLAIN, BENT))
    chosen = models.get(BENT, models.get(PLAIN))
    if chosen is None:
        raise DataError("the camera has no model.", "Is the file damaged?")
    size = image_size(one(entry, "image_width"), one(entry, "image_height"))
    matrix = tuple(one(chosen, n) for n in ("px", "py", "u0", "v0"))
    return polynomial((*matrix, 0.0), size, [one(chosen, "kud", 0.0)] if BENT in models else [])


def _backward(terms: Terms, size: tuple[int, int]) -> float:
    """kdu: a least-squares fit of r_u = r_d (1 + kdu r_d²) up to the corners of the image."""
    corner = (
        max(abs(terms.cx), abs(size[0] - terms.cx)) / terms.fx,
        max(abs(terms.cy), abs(size[1] - terms.cy)) / terms.fy,
    )
    r = np.linspace(0, float(np.hypot(*corner)), FIT)
    bent = r * (1 + terms.get("k1")[0] * r * r)
    cube = bent**3
    return float(cube @ (r - bent) / (cube @ cube))


def _write(cameras: CameraFile, suffix: str) -> str:
    lines = ["<root>"]
    for named in cameras.cameras:
        _, terms = choose(named.camera, MODELS, "a ViSP file")
        width, height = size = named.camera.image_size
        lines += ["  <camera>", f"    <name>{escape(named.name)}</name>"]
        lines += [f"    <image_width>{width}</image_width>", f"    <image_height>{height}</image_height>"]
        base = {"px": terms.fx, "py": terms.fy, "u0": terms.cx, "v0": terms.cy}
        bent = {**base, "kud": terms.get("k1")[0], "kdu": _backward(terms, size)}
        for kind, values in ((PLAIN, base), (BENT, bent)) if not terms.needed else ((BENT, bent),):
            lines += ["    <model>", f"      <type>{kind}</type>"]
            lines += [f"      <{n}>{number(v)}</{n}>" for n, v in values.items()] + ["    </model>"]
        lines.append("  </camera>")
    return header() + "\n".join([*lines, "</root>"]) + "\n"


FORMAT = Format(
    "visp",
    "a ViSP file",
    (".xml",),
    _sniff,
    _read,
    _write,
    MODELS,
    several=True,
    order="px py u0 v0 kud kdu",
    traps=(
        "kud is defined from the scene to the image and is read; kdu is its approximate inverse and is only written.",
        "A camera has two models, without and with distortion; the one with distortion is read.",
    ),
    source="ViSP, vpCameraParameters",
)
