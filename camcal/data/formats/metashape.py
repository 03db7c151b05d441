"""Agisoft Metashape: exported cameras, and the lens file of its calibration dialog.

Metashape manual, appendix on camera models: u = w/2 + cx + x' f + x' b1 + y' b2, v = h/2 + cy + y' f with the
centre of the top-left pixel at (0.5, 0.5); P1 acts on x and P2 on y, the other way round than in OpenCV.
"""

from __future__ import annotations

from typing import Any
from xml.etree.ElementTree import Element
from xml.sax.saxutils import quoteattr

import numpy as np

from camcal.data.formats.base import Array, CameraFile, Format, NamedCamera, image_size, number, unknown
from camcal.data.formats.foreign import at_angle, foreign_camera
from camcal.data.formats.source import Source
from camcal.data.formats.terms import Terms, choose, fisheye, polynomial
from camcal.data.formats.xmlform import header, one

HALF = 0.5
FRAMES, EQUIDISTANT, EQUISOLID = ("frame",), ("fisheye", "equidistant_fisheye"), ("equisolid_fisheye",)
MODELS = ("brown:radial=4,decentering=3+skew", "kb4+skew")


def _sniff(source: Source) -> bool:
    root = source.xml
    if root is None:
        return False
    if root.tag == "calibration":
        return root.find("projection") is not None or root.find("f") is not None
    return root.tag == "document" and root.find("chunk") is not None


def _read(source: Source) -> CameraFile:
    root = source.root
    if root.tag == "calibration":
        return CameraFile.one(_camera(root))
    found = []
    for i, sensor in enumerate(root.iter("sensor")):
        entries = [c for c in sensor.findall("calibration") if c.get("class") != "initial"]
        entries = entries or sensor.findall("calibration")
        if entries:
            name = str(sensor.get("label") or sensor.get("id") or i)
            found.append(NamedCamera(name, _camera(entries[0], sensor.get("type"))))
    return CameraFile(
        tuple(found), ("the poses of the pictures are left out",) * bool(root.findall(".//camera"))
    )


def _size(c: Element) -> tuple[int, int]:
    resolution = c.find("resolution")
    if resolution is not None:
        return image_size(resolution.attrib["width"], resolution.attrib["height"])
    return image_size(one(c, "width"), one(c, "height"))


def _camera(c: Element, kind: str | None = None) -> Any:
    projection = c.find("projection")
    kind = (projection.text or "").strip() if projection is not None else c.get("type", kind or "frame")
    if kind not in (*FRAMES, *EQUIDISTANT, *EQUISOLID):
        raise unknown("Metashape camera type", kind, (*FRAMES, *EQUIDISTANT, *EQUISOLID))
    size = _size(c)

    def value(name: str) -> float:
        return one(c, name, 0.0)

    f = one(c, "f")
    matrix = (
        f + value("b1"),
        f,
        size[0] / 2 + value("cx") - HALF,
        size[1] / 2 + value("cy") - HALF,
        value("b2"),
    )
    k = [value(f"k{i}") for i in (1, 2, 3, 4)]
    p = [value("p2"), value("p1"), value("p3"), value("p4")]  # Metashape's p1 is on x
    if kind in FRAMES:
        return polynomial(matrix, size, k, p)
    if kind in EQUIDISTANT and not any(p):
        return fisheye(matrix, size, k)
    reason = "camcal has no decentering terms for a fisheye lens" if any(p) else "camcal has no such lens"
    return foreign_camera(f"Metashape's {kind}", reason, matrix, size, _forward(kind, k, p), at_angle)


def _forward(kind: str, k: list[float], p: list[float]) -> Any:
    def forward(w: Array) -> Array:
        if kind in EQUISOLID:
            w = w * np.sinc(np.linalg.norm(w, axis=1) / (2 * np.pi))[:, None]
        return polynomial((1, 1, 0, 0, 0), None, k, p).project(np.c_[w, np.ones(len(w))])

    return forward


def _entry(terms: Terms, size: tuple[int, int], indent: str) -> list[str]:
    values = {
        "f": terms.fy,
        "cx": terms.cx + HALF - size[0] / 2,
        "cy": terms.cy + HALF - size[1] / 2,
        "b1": terms.fx - terms.fy,
        "b2": terms.skew,
        **dict(zip(("k1", "k2", "k3", "k4"), terms.get("k1", "k2", "k3", "k4"), strict=True)),
        **dict(zip(("p1", "p2", "p3", "p4"), terms.get("p2", "p1", "p3", "p4"), strict=True)),
    }
    return [f"{indent}<{n}>{number(v)}</{n}>" for n, v in values.items() if v or n == "f"]


def _write(cameras: CameraFile, suffix: str) -> str:
    lines = ['<document version="2.0.0">', '  <chunk label="camcal" enabled="true">']
    lines.append(f'    <sensors next_id="{len(cameras.cameras)}">')
    for i, named in enumerate(cameras.cameras):
        _, terms = choose(named.camera, MODELS, "a Metashape file")
        kind = "frame" if terms.kind == "polynomial" else "fisheye"
        width, height = size = named.camera.image_size
        resolution = f'<resolution width="{width}" height="{height}"/>'
        lines.append(f'      <sensor id="{i}" label={quoteattr(named.name)} type="{kind}">')
        lines += [
            f"        {resolution}",
            f'        <calibration type="{kind}" class="adjusted">',
            f"          {resolution}",
        ]
        lines += _entry(terms, size, " " * 10)
        lines += ["        </calibration>", "      </sensor>"]
    return header() + "\n".join([*lines, "    </sensors>", "  </chunk>", "</document>"]) + "\n"


FORMAT = Format(
    "metashape",
    "a Metashape file",
    (".xml",),
    _sniff,
    _read,
    _write,
    MODELS,
    several=True,
    centre="(0.5, 0.5), from the middle of the image",
    order="f cx cy b1 b2 k1 k2 k3 k4 p1 p2 p3 p4; fx = f + b1, skew = b2",
    traps=(
        "P1 acts on x and P2 on y: OpenCV's p2 and p1.",
        "cx, cy are measured from the image centre.",
        "b1 and b2 act on x; f is fy.",
        "A fisheye lens with decentering has no counterpart in camcal: it is refitted.",
    ),
    source="Agisoft Metashape, user manual, appendix on camera models",
)
