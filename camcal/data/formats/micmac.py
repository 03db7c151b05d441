"""MicMac: AutoCal of Apero. A distortion in px about its own centre, from the scene to the picture:

p = c + d (1 + a r² + b r⁴ + ...) with the ideal pixel c + d (eConvApero_DistM2C).
"""

from __future__ import annotations

from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from camcal.data.formats.base import Array, CameraFile, Format, floats, image_size, number, unknown
from camcal.data.formats.foreign import backward_camera
from camcal.data.formats.source import Source
from camcal.data.formats.terms import choose, polynomial
from camcal.data.formats.xmlform import words
from camcal.errors import DataError

FORWARD, BACKWARD = "eConvApero_DistM2C", "eConvApero_DistC2M"
MODELS = ("brown:radial=5,decentering=0+square", "brown:radial=5,decentering=0,centre=free+square")


def _sniff(source: Source) -> bool:
    root = source.xml
    return root is not None and next(root.iter("CalibrationInternConique"), None) is not None


def _read(source: Source) -> CameraFile:
    root = source.root
    root = next(root.iter("CalibrationInternConique"))
    way = (root.findtext("KnownConv") or FORWARD).strip()
    if way not in (FORWARD, BACKWARD):
        raise unknown("KnownConv", way, (FORWARD, BACKWARD))
    (px, py), f = words(root, "PP", 2), float(words(root, "F", 1)[0])
    size = image_size(*words(root, "SzIm", 2))
    parts = [e for entry in root.findall("CalibDistortion") for e in entry]
    parts = [e for e in parts if e.tag != "ModNoDist"]
    if not parts:
        return CameraFile.one(polynomial((f, f, px, py, 0.0), size))
    if len(parts) > 1 or parts[0].tag not in ("ModRad", "ModPhgrStd"):
        raise DataError(
            f"the distortion {', '.join(p.tag for p in parts)}; camcal reads ModRad and ModPhgrStd.",
            "In MicMac, calibrate with RadialBasic, RadialExtended or FraserBasic.",
        )
    return CameraFile.one(_bent(parts[0], way, (f, px, py), size))


def _bent(part: Element, way: str, matrix: tuple[float, float, float], size: tuple[int, int]) -> Any:
    f, px, py = matrix
    dx, dy = words(part, "CDist", 2)
    k = [float(floats([(e.text or "").strip()])[0]) for e in part.iter("CoeffDist")]
    p = [float(words(part, n, 1, (0.0,))[0]) for n in ("P1", "P2", "b1", "b2")]
    if way == FORWARD and not any(p):
        scaled = [c * f ** (2 * i + 2) for i, c in enumerate(k)]
        return polynomial((f, f, px, py, 0.0), size, scaled, centre=((dx - px) / f, (dy - py) / f))
    if any(p):
        raise DataError(
            "the terms P1, P2, b1 or b2 of ModPhgrStd, which camcal cannot combine with a separate "
            "distortion centre.",
            "In MicMac, calibrate with RadialBasic or RadialExtended.",
        )

    def undistort(w: Array) -> Array:
        d = w * f + np.array([px - dx, py - dy])
        r2 = (d * d).sum(1)
        scale = 1 + sum(c * r2 ** (i + 1) for i, c in enumerate(k))
        return (d * scale[:, None] + np.array([dx - px, dy - py])) / f

    reason = "its series is defined from the image to the scene (C2M), camcal's in the other direction"
    return backward_camera("MicMac's distortion", reason, (f, f, px, py, 0.0), size, undistort)


def _write(cameras: CameraFile, suffix: str) -> str:
    named = cameras.cameras[0]
    _, terms = choose(named.camera, MODELS, "a MicMac calibration")
    f, k = terms.fx, terms.get("k1", "k2", "k3", "k4", "k5")
    xc, yc = terms.get("xc", "yc")
    last = max((i + 1 for i, c in enumerate(k) if c), default=0)
    width, height = named.camera.image_size
    lines = [
        '<?xml version="1.0" ?>',
        "<ExportAPERO>",
        "  <CalibrationInternConique>",
        f"    <KnownConv>{FORWARD}</KnownConv>",
    ]
    lines.append(f"    <PP>{number(terms.cx)} {number(terms.cy)}</PP>")
    lines += [
        f"    <F>{number(f)}</F>",
        f"    <SzIm>{width} {height}</SzIm>",
        "    <CalibDistortion>",
        "      <ModRad>",
    ]
    lines.append(f"        <CDist>{number(terms.cx + f * xc)} {number(terms.cy + f * yc)}</CDist>")
    lines += [
        f"        <CoeffDist>{number(c / f ** (2 * i + 2))}</CoeffDist>" for i, c in enumerate(k[:last])
    ]
    return (
        "\n".join(
            [
                *lines,
                "      </ModRad>",
                "    </CalibDistortion>",
                "  </CalibrationInternConique>",
                "</ExportAPERO>",
            ]
        )
        + "\n"
    )


FORMAT = Format(
    "micmac",
    "a MicMac calibration",
    (".xml",),
    _sniff,
    _read,
    _write,
    MODELS,
    centre="(0, 0), not stated in the program's documentation",
    order="PP, F, SzIm; CDist and CoeffDist in px: r², r⁴, ... about CDist",
    traps=(
        "The distortion centre, CDist, differs from the principal point PP.",
        "KnownConv states the direction; C2M (image to scene) has no exact counterpart and is refitted.",
        "Coefficients are in px: camcal multiplies them by F², F⁴, ...",
    ),
    source="MicMac, documentation of CalibrationInternConique",
)
