"""USD cameras for Isaac Sim (Omniverse): OpenCV's lens in a lens-distortion schema, with a pinhole camera for
Blender.

Omniverse, Lens Distortion Schemas: OmniLensDistortionOpenCvPinholeAPI and OmniLensDistortionOpenCvFisheyeAPI. The
attributes of UsdGeomCamera beside them (focalLength, apertures and their offsets, in mm for a sensor as wide as the
image has px / 1000 mm) say the same pinhole without distortion to programs that know no schema.
"""

from __future__ import annotations

import re

from camcal.data.formats.base import CameraFile, Format, NamedCamera, floats, image_size, number, unknown
from camcal.data.formats.opencv import COUNTS, ORDER
from camcal.data.formats.source import Source
from camcal.data.formats.terms import Terms, camera_of, choose, fisheye
from camcal.errors import DataError
from camcal.model.camera import Camera

MODELS = ("opencv5", "opencv8", "opencv12", "kb4")
PREFIX = "omni:lensdistortion:"
#: the schema's names of the coefficients; those of camcal's in the same order
PINHOLE = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4")
FISHEYE = ("k1", "k2", "k3", "k4")
#: token of the schema, its API's name, its coefficients
SCHEMAS = {
    "opencvPinhole": ("OmniLensDistortionOpenCvPinholeAPI", PINHOLE),
    "opencvFisheye": ("OmniLensDistortionOpenCvFisheyeAPI", FISHEYE),
}
PIXEL_MM = 1e-3  #: nominal side of a pixel, in the millimetres that USD means by apertures
HALF = 0.5
CAMERA = re.compile(r'def\s+Camera\s+"([^"]*)"')
VALUE = re.compile(r"\b\w+\s+" + re.escape(PREFIX) + r"([\w:]+)\s*=\s*([^\n]+)")


def _sniff(source: Source) -> bool:
    return (source.text or "").startswith("#usda") and "def Camera" in (source.text or "")


def _read(source: Source) -> CameraFile:
    text = source.text or ""
    found = list(CAMERA.finditer(text))
    ends = [m.start() for m in found[1:]] + [len(text)]
    return CameraFile(
        tuple(
            NamedCamera(m[1], _camera(m[1], text[m.end() : end])) for m, end in zip(found, ends, strict=True)
        )
    )


def _camera(name: str, body: str) -> Camera:
    values = dict(VALUE.findall(body))
    if "model" not in values:
        raise DataError(
            f"camera '{name}' has no lens-distortion schema, so its image size in px is unknown.",
            "Apply OmniLensDistortionOpenCvPinholeAPI to it, or give its focal length and aperture in "
            "another format.",
        )
    token = values["model"].strip().strip('"')
    if token not in SCHEMAS:
        raise unknown("lens-distortion model", token, SCHEMAS)
    own = {k.partition(":")[2]: v.strip() for k, v in values.items() if k.startswith(f"{token}:")}
    size = image_size(*floats([float(w) for w in own["imageSize"].strip("()").split(",")], 2))
    matrix = (*(float(own[n]) for n in ("fx", "fy", "cx", "cy")), 0.0)
    k = [float(own.get(n, 0.0)) for n in SCHEMAS[token][1]]
    if token == "opencvFisheye":
        return fisheye(matrix, size, k)
    most = 12 if any(k[8:]) else 8 if any(k[5:]) else 5
    return camera_of(COUNTS[most], matrix, size, dict(zip(ORDER[:most], k, strict=False)))


def _write(cameras: CameraFile, suffix: str) -> str:
    blocks = []
    for named in cameras.cameras:
        _, terms = choose(named.camera, MODELS, "a USD camera")
        blocks.append(_block(re.sub(r"\W", "_", named.name) or "camera", terms, named.camera.image_size))
    return "#usda 1.0\n\n" + "\n".join(blocks)


def _block(name: str, terms: Terms, size: tuple[int, int]) -> str:
    token = "opencvFisheye" if terms.kind == "fisheye" else "opencvPinhole"
    api, coefficients = SCHEMAS[token]
    width, height = size
    values = {"fx": terms.fx, "fy": terms.fy, "cx": terms.cx, "cy": terms.cy}
    own = FISHEYE if terms.kind == "fisheye" else ORDER[: len(PINHOLE)]
    values |= dict(zip(coefficients, terms.get(*own), strict=True))
    schema = "".join(f"    float {PREFIX}{token}:{n} = {number(v)}\n" for n, v in values.items())
    aperture = (width * PIXEL_MM, height * PIXEL_MM * terms.fx / terms.fy)  # as if pixels were square
    offset = (
        (0.5 * width - terms.cx - HALF) * PIXEL_MM,
        (terms.cy + HALF - 0.5 * height) * PIXEL_MM * terms.fx / terms.fy,  # y of USD points up
    )
    physical = {
        "focalLength": terms.fx * PIXEL_MM,
        "horizontalAperture": aperture[0],
        "verticalAperture": aperture[1],
        "horizontalApertureOffset": offset[0],
        "verticalApertureOffset": offset[1],
    }
    return (
        f'def Camera "{name}" (\n    prepend apiSchemas = ["{api}"]\n)\n{{\n'
        + "".join(f"    float {n} = {number(v)}\n" for n, v in physical.items())
        + f'    token {PREFIX}model = "{token}"\n'
        + f"    int2 {PREFIX}{token}:imageSize = ({width}, {height})\n"
        + schema
        + "}\n"
    )


FORMAT = Format(
    "usd",
    "a USD camera with OpenCV's lens (Isaac Sim)",
    (".usda",),
    _sniff,
    _read,
    _write,
    MODELS,
    several=True,
    order="fx fy cx cy, k1..k6 p1 p2 s1..s4 (opencvPinhole) or k1..k4 (opencvFisheye), px",
    traps=(
        "Programs without lens-distortion schemas (Blender) read the pinhole camera without distortion "
        "from the apertures.",
        "USD stores single precision: the text file holds all digits, a program that saves it again "
        "keeps about seven.",
        "Binary .usdc files are not read: save as .usda.",
    ),
    source="NVIDIA Omniverse, Lens Distortion Schemas; OpenUSD, UsdGeomCamera",
)
