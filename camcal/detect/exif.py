"""Camera data in the EXIF block of a JPEG or HEIC file: model, focal length, orientation (CIPA DC-008, EXIF 2.32)."""

from __future__ import annotations

import re
import struct

from camcal.records import dataclass

ORIENTATION, MAKE, MODEL, EXIF_IFD = 0x0112, 0x010F, 0x0110, 0x8769
FOCAL_LENGTH, DIGITAL_ZOOM = 0x920A, 0xA404
SIZES = {2: 1, 3: 2, 4: 4, 5: 8}  #: bytes of an ASCII character, a SHORT, a LONG, a RATIONAL
LONGEST_BLOCK = 1 << 16  #: bytes; a JPEG segment, which holds the same data, is no longer
ORIENTATIONS = 8  #: values of the orientation, counted from 1: quarter turns, mirrored or not
LARGEST = 1e6  #: of the numbers that are read (mm, factors); a larger one means damaged data
MOST_ENTRIES = 512  #: entries of a directory; only a damaged one has more
LONGEST_TEXT = 64  #: characters kept of the name of a maker or model


@dataclass(frozen=True)
class Taken:
    """How a picture was taken; empty or 0 if the file has no such data.

    Attributes
    ----------
    camera : str
        Maker and model.
    focal : float
        Focal length, mm.
    zoom : float
        Digital zoom, 1 where there is none.
    orientation : int
        1 is upright, 6 and 8 are rotated by 90 degrees, 3 by 180 degrees; other values are mirrored.
    """

    camera: str = ""
    focal: float = 0.0
    zoom: float = 1.0
    orientation: int = 1

    def __str__(self) -> str:
        """Return the camera and the focal length in words."""
        focal = f"at {self.focal:g} mm" if self.focal else ""
        zoom = f"zoomed {self.zoom:g} times" if self.zoom > 1 else ""
        return " ".join(word for word in (self.camera, focal, zoom) if word) or "an unnamed camera"


UNKNOWN = Taken()


def read_exif(data: bytes) -> Taken:
    """Read the EXIF data of a JPEG or HEIC file; an empty `Taken` for any other file or a damaged block."""
    try:
        tiff = _block(data)
        if not tiff:
            return UNKNOWN
        order = {b"II": "<", b"MM": ">"}[tiff[:2]]
        (start,) = struct.unpack(order + "I", tiff[4:8])
        main = _directory(tiff, start, order)
        nested = _directory(tiff, int(main[EXIF_IFD]), order) if EXIF_IFD in main else {}
    except (struct.error, KeyError, ValueError, IndexError, OverflowError):
        return UNKNOWN
    make, model = (str(main.get(tag, "")) for tag in (MAKE, MODEL))
    camera = model if model.lower().startswith(make.lower()) else f"{make} {model}".strip()
    numbers = (_number(nested.get(FOCAL_LENGTH)), _number(nested.get(DIGITAL_ZOOM)))
    turned = int(_number(main.get(ORIENTATION)))
    return Taken(
        camera,
        round(numbers[0], 3),
        max(1.0, round(numbers[1], 3)),
        turned if 1 <= turned <= ORIENTATIONS else 1,
    )


def _number(value: object) -> float:
    return float(value) if isinstance(value, (int, float)) and 0 <= value < LARGEST else 0.0


def _block(data: bytes) -> bytes:
    """The TIFF structure in the APP1 segment of a JPEG file, or in the item of a HEIC file (ISO/IEC 23008-12, A.2)."""
    if data[4:8] == b"ftyp":
        found = re.search(rb"Exif\0\0(?=MM\0\*|II\*\0)", data)
        return data[found.end() : found.end() + LONGEST_BLOCK] if found else b""
    at = 2 if data.startswith(b"\xff\xd8") else len(data)
    while at + 4 <= len(data) and data[at] == 0xFF and 0xE0 <= data[at + 1] <= 0xEF:
        (length,) = struct.unpack(">H", data[at + 2 : at + 4])
        segment = data[at + 4 : at + 2 + length]
        if data[at + 1] == 0xE1 and segment.startswith(b"Exif\0\0"):
            return segment[6:]
        at += 2 + length
    return b""


def _directory(tiff: bytes, start: int, order: str) -> dict[int, str | int | float]:
    """The entries of a directory whose types are used here: the first value of each."""
    (count,) = struct.unpack(order + "H", tiff[start : start + 2])
    found: dict[int, str | int | float] = {}
    for i in range(min(count, MOST_ENTRIES)):
        at = start + 2 + 12 * i
        tag, kind, number = struct.unpack(order + "HHI", tiff[at : at + 8])
        size = SIZES.get(kind, 0) * number
        if not size:
            continue
        place = at + 8 if size <= 4 else struct.unpack(order + "I", tiff[at + 8 : at + 12])[0]
        if kind == 2:
            raw = tiff[place : place + min(size, LONGEST_TEXT)]
            found[tag] = raw.split(b"\0")[0].decode("latin-1").strip()
        elif kind == 5:
            a, b = struct.unpack(order + "II", tiff[place : place + 8])
            found[tag] = a / b if b else 0.0
        else:
            (found[tag],) = struct.unpack(order + "HI"[kind - 3], tiff[place : place + SIZES[kind]])
    return found
