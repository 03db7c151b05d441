"""The size of a picture from the header of its file, before anything is decoded."""

from __future__ import annotations

import struct
from collections.abc import Callable

Size = tuple[int, int]

_WIDTH, _HEIGHT = 256, 257  #: tags of TIFF 6.0
_SHORT, _LONG = 3, 4  #: types of TIFF 6.0
MOST_ENTRIES = 1000  #: entries of a TIFF directory; files of cameras have some dozens
BOXES = (b"meta", b"iprp", b"ipco", b"jp2h")  #: boxes of ISO/IEC 14496-12 and 15444-1 that hold boxes
DEEPEST = 6  #: nested boxes; meta, iprp, ipco are three


def header_size(data: bytes) -> Size | None:
    """(width, height) from the header of a file; None if the format is unknown or the header damaged."""
    for beginning, read in _READERS.items():
        if data.startswith(beginning):
            try:
                return read(data)
            except (struct.error, ValueError, IndexError):
                return None
    if data[4:8] in (b"ftyp", b"jP  "):
        return _boxes(data, 0, len(data), 0)
    return None


def _png(data: bytes) -> Size | None:
    return struct.unpack(">II", data[16:24])


def _bmp(data: bytes) -> Size | None:
    width, height = struct.unpack("<ii", data[18:26])
    return abs(width), abs(height)


def _pnm(data: bytes) -> Size | None:
    lines = [line.partition(b"#")[0] for line in data[2:4096].split(b"\n")]
    words = b" ".join(lines).split()[:2]
    return (int(words[0]), int(words[1])) if len(words) == 2 and all(w.isdigit() for w in words) else None


def _jpeg(data: bytes) -> Size | None:
    """Walk the segments to the frame header (ITU T.81, B.2.2)."""
    at = 2
    while at + 9 < len(data):
        if data[at] != 0xFF:
            return None
        marker = data[at + 1]
        if marker == 0xFF:
            at += 1
        elif 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack(">HH", data[at + 5 : at + 9])
            return width, height
        else:
            at += 2 + struct.unpack(">H", data[at + 2 : at + 4])[0]
    return None


def _tiff(data: bytes) -> Size | None:
    """Width and height of the first directory (TIFF 6.0, section 2)."""
    order = "<" if data[:2] == b"II" else ">"
    at = struct.unpack(order + "I", data[4:8])[0]
    (count,) = struct.unpack(order + "H", data[at : at + 2])
    found = {}
    for i in range(min(count, MOST_ENTRIES)):
        entry = data[at + 2 + 12 * i : at + 14 + 12 * i]
        tag, kind = struct.unpack(order + "HH", entry[:4])
        if tag in (_WIDTH, _HEIGHT) and kind in (_SHORT, _LONG):
            form = "H" if kind == _SHORT else "I"
            (found[tag],) = struct.unpack(order + form, entry[8 : 10 if kind == _SHORT else 12])
    return (found[_WIDTH], found[_HEIGHT]) if len(found) == 2 else None


def _webp(data: bytes) -> Size | None:
    """Width and height of the three kinds of WebP (RFC 9649, sections 2.5 to 2.7)."""
    if data[8:12] != b"WEBP":
        return None
    if data[12:16] == b"VP8X":
        return 1 + int.from_bytes(data[24:27], "little"), 1 + int.from_bytes(data[27:30], "little")
    if data[12:16] == b"VP8L":
        bits = int.from_bytes(data[21:25], "little")
        return 1 + (bits & 0x3FFF), 1 + (bits >> 14 & 0x3FFF)
    width, height = struct.unpack("<HH", data[26:30])
    return width & 0x3FFF, height & 0x3FFF


def _gif(data: bytes) -> Size | None:
    return struct.unpack("<HH", data[6:10])


def _sun(data: bytes) -> Size | None:
    return struct.unpack(">II", data[4:12])


def _exr(data: bytes) -> Size | None:
    """The attribute dataWindow: xMin, yMin, xMax, yMax."""
    at = data.index(b"dataWindow\0box2i\0") + len(b"dataWindow\0box2i\0") + 4
    left, top, right, bottom = struct.unpack("<4i", data[at : at + 16])
    return right - left + 1, bottom - top + 1


def _radiance(data: bytes) -> Size | None:
    """The line after the header: `-Y height +X width`."""
    words = data[:65536].partition(b"\n\n")[2].split(b"\n")[0].split()
    return (int(words[3]), int(words[1])) if len(words) == 4 else None


def _codestream(data: bytes) -> Size | None:
    """The marker SIZ of a JPEG 2000 codestream (ISO/IEC 15444-1, A.5.1)."""
    right, bottom, left, top = struct.unpack(">4I", data[8:24])
    return right - left, bottom - top


def _boxes(data: bytes, at: int, end: int, depth: int) -> Size | None:
    """The largest size that `ispe` or `ihdr` boxes state: HEIF and AVIF (ISO/IEC 23008-12), JPEG 2000."""
    sizes: list[Size] = []
    while at + 8 <= end:
        length, kind = struct.unpack(">I4s", data[at : at + 8])
        body, stop = at + 8, min(end, at + length) if length else end
        if length == 1:
            body, stop = at + 16, min(end, at + int.from_bytes(data[at + 8 : at + 16], "big"))
        if stop < body:
            break
        if kind == b"ispe" and stop - body >= 12:
            sizes.append(struct.unpack(">II", data[body + 4 : body + 12]))
        elif kind == b"ihdr" and stop - body >= 8:
            height, width = struct.unpack(">II", data[body : body + 8])
            sizes.append((width, height))
        elif kind in BOXES and depth < DEEPEST:
            inside = _boxes(data, body + 4 * (kind == b"meta"), stop, depth + 1)
            sizes += [inside] if inside else []
        at = stop
    return max(sizes, key=lambda size: size[0] * size[1], default=None)


_READERS: dict[bytes, Callable[[bytes], Size | None]] = {
    b"\x89PNG\r\n\x1a\n": _png,
    b"BM": _bmp,
    **{b"P" + kind: _pnm for kind in (b"1", b"2", b"3", b"4", b"5", b"6", b"F", b"f")},
    b"\xff\xd8": _jpeg,
    b"II*\0": _tiff,
    b"MM\0*": _tiff,
    b"RIFF": _webp,
    b"GIF8": _gif,
    b"\x59\xa6\x6a\x95": _sun,
    b"\x76\x2f\x31\x01": _exr,
    b"#?": _radiance,
    b"\xff\x4f\xff\x51": _codestream,
}
