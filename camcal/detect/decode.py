"""Decoding of picture files to grey arrays; a file gives either a picture or the reason why it cannot be read.

The EXIF orientation is ignored on purpose: it records how the camera was held, which does not affect the lens, and
rotated pixels would have another principal point. A grey picture is read as it is; a colour picture is converted to
luma. The channels of a raw Bayer mosaic are equalised (`mosaic.py`).
"""

from __future__ import annotations

import io
import re
from importlib import import_module

import cv2
import numpy as np

from camcal.detect.headers import header_size
from camcal.detect.mosaic import evened, levels

Array = np.ndarray

#: a picture with more is not decoded: the largest single-exposure cameras have 151 million (2026), and finding a
#: board takes about 20 bytes per pixel
MOST_PIXELS = 200_000_000
JPEG = b"\xff\xd8"
LONGEST_META = (
    1 << 20
)  #: bytes at the start of a HEIC file in which the properties of its items are looked for
HEIC_BRANDS = (b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1")
FLAGS = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION


class UnreadableError(Exception):
    """A file is not a picture, or is damaged; the message is the reason."""


def decode_gray(data: bytes) -> Array:
    """Decode the bytes of a picture file.

    Returns
    -------
    (height, width) uint8 or uint16 array

    Raises
    ------
    UnreadableError
        If the file cannot be decoded; the message is the reason.
    """
    size = check_size(data)
    cut = _truncated(data)
    if cut:
        raise UnreadableError(cut)
    picture = decoded(np.frombuffer(data, np.uint8), FLAGS)
    if picture is None or picture.size == 0:
        heic = read_heic(data)
        if heic is None:
            raise UnreadableError("it is damaged" if size else "it is not a picture of a known format")
        picture = heic
    gray = as_gray(picture)
    # JPEG compression does not preserve a mosaic
    phases = levels(gray) if picture.ndim == 2 and not data.startswith(JPEG) else None
    return gray if phases is None else evened(gray, phases)


def decoded(data: Array, flags: int) -> Array | None:
    """The picture as decoded by OpenCV; None if it cannot decode it.

    Raises
    ------
    UnreadableError
        If its decoder fails or there is not enough memory.
    """
    try:
        return cv2.imdecode(data, flags)
    except cv2.error as error:
        raise UnreadableError(f"decoding failed: {str(error.err).strip()[:80]}") from error
    except MemoryError as error:
        raise UnreadableError("there is not enough memory to decode it") from error


def read_heic(data: bytes) -> Array | None:
    """Decode a HEIC picture (ISO/IEC 23008-12), the format of many phones, with pillow-heif.

    Returns
    -------
    (height, width) or (height, width, 3) array
        In the orientation of the sensor, blue first; None for a file of another format.

    Raises
    ------
    UnreadableError
        If pillow-heif is not installed or cannot decode the file.
    """
    if data[4:8] != b"ftyp" or data[8:12] not in HEIC_BRANDS:
        return None
    try:
        pillow_heif = import_module("pillow_heif")
    except ImportError:
        raise UnreadableError(
            "it is a HEIC picture, which OpenCV does not read: convert it to JPEG or PNG, or install pillow-heif"
        ) from None
    try:
        picture = np.asarray(pillow_heif.open_heif(io.BytesIO(data), convert_hdr_to_8bit=False))
    except Exception as error:  # a decoder may raise anything on a damaged file
        reason = str(error)[:80].strip().rstrip(".")
        raise UnreadableError(
            f"it is a HEIC picture that pillow-heif cannot decode ({reason}): convert it to JPEG or PNG, or replace "
            "it if it is damaged"
        ) from error
    picture = np.rot90(picture, -_quarter_turns(data))
    return picture if picture.ndim == 2 else picture[..., 2::-1]  # blue first, as OpenCV has it


def _quarter_turns(data: bytes) -> int:
    """The number of left quarter turns for display of a HEIC picture (ISO/IEC 23008-12, 6.5.10, box `irot`)."""
    found = re.search(rb"\0\0\0\x09irot(.)", data[:LONGEST_META], re.DOTALL)
    return found[1][0] & 3 if found else 0


def check_size(data: bytes) -> tuple[int, int] | None:
    """Check the size in the header, if there is one.

    Raises
    ------
    UnreadableError
        If the file is empty or the picture has more than `MOST_PIXELS`.
    """
    if not data:
        raise UnreadableError("the file is empty")
    size = header_size(data)
    if size and size[0] * size[1] > MOST_PIXELS:
        raise UnreadableError(
            f"{size[0]}x{size[1]} pixels are more than the {MOST_PIXELS // 10**6} million allowed"
        )
    if size and min(size) < 1:
        raise UnreadableError(f"a picture of {size[0]}x{size[1]} pixels: the file is damaged")
    return size


def as_gray(picture: Array) -> Array:
    """Convert a decoded picture of one or several channels to grey of 8 or 16 bits; colours become their luma."""
    if picture.ndim == 3 and picture.shape[2] >= 3:
        picture = cv2.cvtColor(np.ascontiguousarray(picture[..., :3]), cv2.COLOR_BGR2GRAY)
    return _as_integers(picture if picture.ndim == 2 else picture[..., 0])


def _as_integers(picture: Array) -> Array:
    """Keep 8 and 16 bits; scale other number types to 16 bits."""
    if picture.dtype in (np.uint8, np.uint16):
        return picture
    values = np.nan_to_num(picture.astype(np.float32), nan=0.0, posinf=0.0, neginf=0.0)
    low, high = float(values.min()), float(values.max())
    return ((values - low) * (65535.0 / max(high - low, 1e-30))).astype(np.uint16)


def _truncated(data: bytes) -> str | None:
    """The reason if the end of a JPEG or PNG file is missing, else None; decoders silently fill the gap with grey."""
    if data.startswith(b"\xff\xd8"):
        whole = data.rfind(b"\xff\xd9") > data.rfind(b"\xff\xda") > 0
        return None if whole else "the JPEG file is truncated: its end marker is missing"
    if data.startswith(b"\x89PNG"):
        return None if b"IEND" in data else "the PNG file is truncated: its end is missing"
    return None
