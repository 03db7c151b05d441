"""Adobe Lens Profile Creator: LCP files, with a camera for each focal length, distance and aperture.

Adobe Lens Profile Creator user guide, the perspective model (OpenCV's polynomial) and the fisheye model
(θ + k1 θ³ + k2 θ⁵); lengths in units of the longer side, the centre as a part of each side.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any
from xml.etree.ElementTree import Element
from xml.sax.saxutils import escape

from camcal.data.formats.base import CameraFile, Format, NamedCamera, image_size, number
from camcal.data.formats.source import Source
from camcal.data.formats.terms import choose, fisheye, polynomial
from camcal.errors import DataError

HALF = 0.5
MODELS = ("opencv5", "kb:2")
SPACES = (
    'xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"',
    'xmlns:photoshop="http://ns.adobe.com/photoshop/1.0/"',
    'xmlns:stCamera="http://ns.adobe.com/photoshop/1.0/camera-profile"',
)
MOST = 500  #: entries of one file; a zoom lens has some hundred


def _sniff(source: Source) -> bool:
    root = source.xml
    return root is not None and root.tag == "xmpmeta" and any(True for _ in _entries(root))


def _entries(root: Element) -> Iterator[Element]:
    """The descriptions that contain a lens model."""
    for entry in root.iter():
        if any(child.tag in ("PerspectiveModel", "FisheyeModel") for child in entry):
            yield entry


def _values(element: Element) -> dict[str, str]:
    """Entries of a resource, as attributes or elements, of itself and of its rdf:Description."""
    found = dict(element.attrib)
    for child in element:
        if child.tag == "Description":
            found |= _values(child)
        elif len(child) == 0 and child.text:
            found[child.tag] = child.text.strip()
    return found


def _read(source: Source) -> CameraFile:
    found: list[NamedCamera] = []
    for entry in _entries(source.root):
        own = _values(entry)
        if len(found) >= MOST:
            break
        name = f"{own.get('FocalLength', '?')}mm-{own.get('FocusDistance', '?')}m-{own.get('ApertureValue', '?')}"
        found.append(NamedCamera(name, _camera(entry, own)))
    return CameraFile(tuple(found))


def _camera(entry: Element, own: dict[str, str]) -> Any:
    model = next(c for c in entry if c.tag in ("PerspectiveModel", "FisheyeModel"))
    values = _values(model)
    if "ImageWidth" not in own:
        raise DataError(
            "a profile without the size of the image (ImageWidth, ImageLength).", "Use another profile."
        )
    if "FocalLengthX" not in values:
        raise DataError(
            "a profile without FocalLengthX.", "Its focal length in px is not known: use another profile."
        )
    size = image_size(own["ImageWidth"], own["ImageLength"])
    longer = max(size)
    fx = float(values["FocalLengthX"]) * longer
    fy = float(values.get("FocalLengthY", values["FocalLengthX"])) * longer
    cx, cy = (
        float(values.get("ImageXCenter", HALF)) * size[0],
        float(values.get("ImageYCenter", HALF)) * size[1],
    )
    matrix = (fx, fy, cx - HALF, cy - HALF, 0.0)
    k = [float(values.get(f"RadialDistortParam{i}", 0)) for i in (1, 2, 3)]
    p = [float(values.get(f"TangentialDistortParam{i}", 0)) for i in (1, 2)]
    if model.tag == "PerspectiveModel":
        return polynomial(matrix, size, k, p)
    return fisheye(matrix, size, k[:2])


def _write(cameras: CameraFile, suffix: str) -> str:
    _, terms = choose(cameras.cameras[0].camera, MODELS, "an Adobe lens profile")
    width, height = cameras.cameras[0].camera.image_size
    longer = max(width, height)
    k, p = terms.get("k1", "k2", "k3"), terms.get("p1", "p2")
    values = {
        "Version": "2",
        "FocalLengthX": number(terms.fx / longer),
        "FocalLengthY": number(terms.fy / longer),
        "ImageXCenter": number((terms.cx + HALF) / width),
        "ImageYCenter": number((terms.cy + HALF) / height),
    }
    count = 3 if terms.kind == "polynomial" else 2
    values |= {f"RadialDistortParam{i}": number(v) for i, v in enumerate(k[:count], 1)}
    if any(p):
        values |= {f"TangentialDistortParam{i}": number(v) for i, v in enumerate(p, 1)}
    model = "PerspectiveModel" if terms.kind == "polynomial" else "FisheyeModel"
    inner = "".join(f"       <stCamera:{n}>{v}</stCamera:{n}>\n" for n, v in values.items())
    name = escape(cameras.cameras[0].name)
    fields = f"<stCamera:ProfileName>{name}</stCamera:ProfileName>\n"
    fields += "".join(
        f"      <stCamera:{n}>{v}</stCamera:{n}>\n"
        for n, v in (("ImageWidth", width), ("ImageLength", height))
    )
    return (
        f'<x:xmpmeta xmlns:x="adobe:ns:meta/">\n <rdf:RDF {SPACES[0]}>\n'
        f'  <rdf:Description rdf:about="" {SPACES[1]} {SPACES[2]}>\n'
        '   <photoshop:CameraProfiles>\n    <rdf:Seq>\n     <rdf:li rdf:parseType="Resource">\n'
        f"      {fields}"
        f'      <stCamera:{model} rdf:parseType="Resource">\n{inner}      </stCamera:{model}>\n'
        "     </rdf:li>\n    </rdf:Seq>\n   </photoshop:CameraProfiles>\n"
        "  </rdf:Description>\n </rdf:RDF>\n</x:xmpmeta>\n"
    )


FORMAT = Format(
    "lcp",
    "an Adobe lens profile",
    (".lcp",),
    _sniff,
    _read,
    _write,
    MODELS,
    several=False,
    centre="(0.5, 0.5)",
    order="FocalLengthX/Y over the longer side, ImageX/YCenter over width and height; k1 k2 k3, then p1 p2 as OpenCV's",
    traps=(
        "A file has an entry for each focal length, focus distance and aperture: choose with --camera.",
        "Profiles without FocalLengthX say the focal length in mm only and are refused.",
        "Vignetting and chromatic models are omitted.",
    ),
    source="Adobe Lens Profile Creator, user guide and lens model",
)
