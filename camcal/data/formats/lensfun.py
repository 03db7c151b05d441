"""LensFun's database: XML with a distortion for each focal length of a lens.

LensFun, Distortion models. Radii are in units of half the shorter side of the sensor, R_u of the image without
distortion, R_d of the one as taken, about the lens's centre:

    poly3:  R_d = R_u (1 - k1 + k1 R_u²)                                                                   (1)
    poly5:  R_d = R_u (1 + k1 R_u² + k2 R_u⁴)                                                              (2)
    ptlens: R_d = R_u (a R_u³ + b R_u² + c R_u + 1 - a - b - c)                                             (3)

With the focal length f in those units, r = R_u / f is the tangent of the angle, so that (1) and (2) are Brown's
polynomial with k_i scaled by f^(2 i). (3) has odd powers, which no lens of camcal's has: it can be refitted.
"""

from __future__ import annotations

from functools import partial
from typing import Any
from xml.etree.ElementTree import Element
from xml.sax.saxutils import escape

import numpy as np

from camcal.data.formats.base import (
    CameraFile,
    ForeignCamera,
    ForeignLens,
    Format,
    NamedCamera,
    number,
    size_said,
    unknown,
)
from camcal.data.formats.source import Source
from camcal.data.formats.terms import choose, polynomial
from camcal.data.formats.xmlform import header
from camcal.errors import DataError

Array = np.ndarray

MODELS = ("brown:radial=2,decentering=0+square",)
FULL_FRAME = float(np.hypot(36.0, 24.0))  #: mm; the diagonal that a crop factor of 1 stands for
ASPECT = 1.5  #: of the sensor where the file does not say it
MOST = 500  #: distortions of one file; a zoom lens has a dozen
STEPS = 30  #: of Newton's method for the radius without distortion; five do for real lenses
#: px; nominal longer side of a camera that the file gives no size of
LONGER = 6000
#: half short sides; a radius is inverted where no more is left, 1e-6 px of 1000 px
FOUND = 1e-9


def _sniff(source: Source) -> bool:
    return source.xml is not None and source.xml.tag == "lensdatabase"


def _read(source: Source) -> CameraFile:
    found: list[NamedCamera] = []
    said = size_said(source)
    for lens in source.root.iter("lens"):
        model = (lens.findtext("model") or "lens").strip()
        for entry in lens.iter("distortion"):
            if len(found) < MOST:
                found.append(NamedCamera(f"{model} {entry.get('focal', '?')}mm", _camera(lens, entry, said)))
    if not found:
        raise DataError(
            "no lens in the file has a distortion.", "Give a database file with <distortion> entries."
        )
    if said:
        return CameraFile(tuple(found))
    note = f"the file has no image size: {LONGER} px is assumed for the longer side; give --image-size if it is known"
    return CameraFile(tuple(found), (note,))


def _camera(lens: Element, entry: Element, size: tuple[int, int] | None) -> Any:
    if (lens.findtext("type") or "rectilinear").strip() != "rectilinear":
        raise DataError("the lens is not rectilinear.", "LensFun's fisheye projections are not read.")
    crop = float(lens.findtext("cropfactor") or 1.0)
    a, _, b = (lens.findtext("aspect-ratio") or str(ASPECT)).partition(":")
    aspect = float(a) / float(b or 1)
    focal = float(entry.get("real-focal") or entry.get("focal") or "nan")
    if not (crop > 0 and aspect > 0 and focal > 0):
        raise ValueError("crop factor, aspect ratio and focal length must be positive")
    f = 2 * focal / (FULL_FRAME / crop / np.hypot(1.0, aspect))  # in half shorter sides
    width, height = size or (LONGER, round(LONGER / max(aspect, 1 / aspect)))
    half = min(width, height) / 2
    centre = lens.find("center")
    x, y = (float(centre.get(n, 0)) if centre is not None else 0.0 for n in "xy")
    matrix = (f * half, f * half, (width - 1) / 2 + x * half, (height - 1) / 2 + y * half, 0.0)
    model = entry.get("model", "")
    k = [float(entry.get(n, 0)) for n in ("k1", "k2")]
    if model == "poly3":
        scale = 1 - k[0]
        matrix = (matrix[0] * scale, matrix[1] * scale, *matrix[2:])
        return polynomial(matrix, (width, height), [k[0] / scale * f**2, 0.0], [0.0, 0.0])
    if model == "poly5":
        return polynomial(matrix, (width, height), [k[0] * f**2, k[1] * f**4], [0.0, 0.0])
    if model != "ptlens":
        raise unknown("distortion model", model, ("poly3", "poly5", "ptlens"))
    abc = [float(entry.get(n, 0)) for n in "abc"]
    rays = partial(_rays, matrix=matrix, half=half, abc=abc)
    return ForeignCamera(ForeignLens("ptlens", "odd powers of the radius", rays), (width, height))


def _rays(uv: Array, matrix: Any, half: float, abc: list[float]) -> tuple[Array, Array]:
    """Rays (N, 3) of pixels (N, 2) by (3), and which pixels have one."""
    off = (uv - [matrix[2], matrix[3]]) / half
    bent = np.linalg.norm(off, axis=1)
    a, b, c = abc
    d = 1 - a - b - c
    r = bent.copy()
    for _ in range(STEPS):
        value = r * (d + r * (c + r * (b + r * a))) - bent
        r = r - value / (d + r * (2 * c + r * (3 * b + r * 4 * a)))
    good = np.isfinite(r) & (r >= 0) & (np.abs(r * (d + r * (c + r * (b + r * a))) - bent) < FOUND)
    plane = off * np.where(bent > 0, r / np.maximum(bent, 1e-300), 1.0)[:, None] / (matrix[0] / half)
    rays = np.c_[plane, np.ones(len(plane))]
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    return np.where(good[:, None], rays, np.nan), good


def _write(cameras: CameraFile, suffix: str) -> str:
    named = cameras.cameras[0]
    _, terms = choose(named.camera, MODELS, "a LensFun database")
    width, height = named.camera.image_size
    half = min(width, height) / 2
    f, aspect = terms.fx / half, max(width, height) / min(width, height)
    k = terms.get("k1", "k2")
    focal = f * FULL_FRAME / np.hypot(1.0, aspect) / 2  # mm of a full-frame sensor
    centre = (terms.cx - (width - 1) / 2) / half, (terms.cy - (height - 1) / 2) / half
    values = {"focal": focal, "real-focal": focal, "k1": k[0] / f**2, "k2": k[1] / f**4}
    attributes = " ".join(f'{n}="{number(v)}"' for n, v in values.items())
    name = escape(named.name)
    return (
        header() + f"<!-- image of {width}x{height} px -->\n" + '<lensdatabase version="2">\n  <lens>\n'
        f"    <maker>unknown</maker>\n    <model>{name}</model>\n    <mount>Generic</mount>\n"
        f"    <cropfactor>1</cropfactor>\n    <aspect-ratio>{number(aspect)}</aspect-ratio>\n"
        f'    <center x="{number(centre[0])}" y="{number(centre[1])}"/>\n    <calibration>\n'
        f'      <distortion model="poly5" {attributes}/>\n'
        "    </calibration>\n  </lens>\n</lensdatabase>\n"
    )


FORMAT = Format(
    "lensfun",
    "a LensFun database (XML)",
    (".xml",),
    _sniff,
    _read,
    _write,
    MODELS,
    size=False,
    order="focal (mm), crop factor, k1 k2 (poly3, poly5) or a b c (ptlens) over half the shorter side",
    traps=(
        "The file has no lengths in px: without --image-size the longer side is assumed to be 6000 px.",
        "center is the offset of the principal point from the image centre, over half the shorter side.",
        "ptlens has odd powers of the radius: --to-model refits it.",
        "Focal lengths are in mm, on a sensor of the given crop factor; camcal writes those of a full-frame sensor.",
    ),
    source="LensFun, Distortion models and lens calibration",
)
