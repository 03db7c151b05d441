"""RealityCapture's XMP file of a picture: lengths relative to the picture's longer side, Brown's terms, the pose."""

from __future__ import annotations

from typing import Any

from camcal.data.formats.base import CameraFile, Format, NamedCamera, floats, number, size_needed, unknown
from camcal.data.formats.source import Source
from camcal.data.formats.terms import choose, polynomial
from camcal.errors import DataError
from camcal.model.pose import Pose

MODELS = ("pinhole+square", "brown:radial=4,decentering=1+square")
KNOWN = ("perspective", "brown3", "brown4", "brown3t2", "brown4t2")
#: mm; the width of the film that FocalLength35mm belongs to
FILM = 36.0


def _entries(source: Source) -> dict[str, str]:
    """Attributes and elements of the description, by name without the namespace."""
    found: dict[str, str] = {}
    for element in source.root.iter("Description"):
        found |= dict(element.attrib)
        found |= {child.tag: child.text or "" for child in element}
    return found


def _sniff(source: Source) -> bool:
    return source.xml is not None and source.xml.tag == "xmpmeta" and "FocalLength35mm" in _entries(source)


def _numbers(text: str, count: int | tuple[int, ...], name: str) -> Any:
    return floats([float(w) for w in text.split()], count, name)


def _read(source: Source) -> CameraFile:
    found, size = _entries(source), size_needed(source)
    kind = found.get("DistortionModel", "perspective")
    if kind not in KNOWN:
        raise unknown("distortion model", kind, KNOWN)

    def value(name: str, default: str = "0") -> float:
        return float(_numbers(found.get(name, default), 1, name)[0])

    if value("Skew") != 0 or value("AspectRatio", "1") != 1:
        raise DataError(
            "it has a skew or an aspect ratio other than 1, whose units are not documented.",
            "Calibrate with square pixels.",
        )
    width, height = size
    longer = max(size)
    f = value("FocalLength35mm") / FILM * longer
    centre = [width / 2 + value("PrincipalPointU") * longer, height / 2 + value("PrincipalPointV") * longer]
    d = _numbers(found.get("DistortionCoeficients", ""), (0, 3, 6), "DistortionCoeficients").tolist()
    k1, k2, k3, k4, t1, t2 = (d + [0.0] * 6)[:6]
    bend = ([k1, k2, k3, k4], [t2, t1]) if kind != "perspective" else ([], [])
    camera = polynomial((f, f, centre[0] - 0.5, centre[1] - 0.5, 0.0), size, *bend)
    return CameraFile((NamedCamera("camera", camera, _pose(found)),))


def _pose(found: dict[str, str]) -> Pose | None:
    """The rotation is cam_from_world; Position is the camera centre in the world."""
    if "Rotation" not in found or "Position" not in found:
        return None
    rotation = _numbers(found["Rotation"], 9, "Rotation").reshape(3, 3)
    return Pose(rotation, -rotation @ _numbers(found["Position"], 3, "Position"))


def _write(cameras: CameraFile, suffix: str) -> str:
    named = cameras.cameras[0]
    _, terms = choose(named.camera, MODELS, "an XMP of RealityCapture")
    width, height = named.camera.image_size
    longer = max(width, height)
    k, (p1, p2) = terms.get("k1", "k2", "k3", "k4"), terms.get("p1", "p2")
    kind = (
        ("brown4" if k[3] else "brown3") + ("t2" if p1 or p2 else "") if any((*k, p1, p2)) else "perspective"
    )
    attributes = {
        "Version": "3",
        "PosePrior": "initial",
        "Coordinates": "absolute",
        "DistortionModel": kind,
        "FocalLength35mm": number(terms.fx / longer * FILM),
        "Skew": "0",
        "AspectRatio": "1",
        "PrincipalPointU": number((terms.cx + 0.5 - width / 2) / longer),
        "PrincipalPointV": number((terms.cy + 0.5 - height / 2) / longer),
        "CalibrationPrior": "initial",
        "CalibrationGroup": "-1",
        "DistortionGroup": "-1",
    }
    pose = named.pose or Pose.identity()
    elements = {
        "Rotation": pose.rotation.ravel(),
        "Position": -pose.rotation.T @ pose.translation,
        "DistortionCoeficients": [*k, p2, p1],
    }
    said = "\n".join(f'      xcr:{n}="{v}"' for n, v in attributes.items())
    held = "\n".join(f"      <xcr:{n}>{' '.join(map(number, v))}</xcr:{n}>" for n, v in elements.items())
    return (
        f'<x:xmpmeta xmlns:x="adobe:ns:meta/">\n  <!-- image of {width}x{height} px -->\n'
        '  <rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">\n'
        '    <rdf:Description xmlns:xcr="http://www.capturingreality.com/ns/xcr/1.1#"\n'
        f"{said}>\n{held}\n    </rdf:Description>\n  </rdf:RDF>\n</x:xmpmeta>\n"
    )


FORMAT = Format(
    "realitycapture",
    "an XMP of RealityCapture",
    (".xmp",),
    _sniff,
    _read,
    _write,
    MODELS,
    poses=True,
    size=True,
    centre="(0.5, 0.5), from the middle of the image",
    order="FocalLength35mm over 36 and PrincipalPointU, V of the longer side; k1 k2 k3 k4 t1 t2; "
    "Rotation and Position, x_cam = R (x - position)",
    traps=(
        "The file does not state the image size: give --image-size.",
        "t1 acts on x and t2 on y: OpenCV's p2 and p1.",
        "Position is the position of the camera, not the translation of the pose.",
        "The division model, skew and aspect ratio are refused: their units are not documented.",
    ),
    source="AliceVision, importKnownPoses, and Fraunhofer's Camorph, which read the program's files",
)
