"""Pages of multi-page TIFF files and frames of animated PNG, WebP and AVIF files, counted from 0."""

from __future__ import annotations

import hashlib
import struct
import zipfile
import zlib
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO, BinaryIO, NamedTuple

import cv2
import numpy as np

from camcal.detect.decode import FLAGS, UnreadableError, check_size
from camcal.system.reading import is_file

Array = np.ndarray

PNG = b"\x89PNG\r\n\x1a\n"
#: bytes of decoded frames that are kept. Decoding a frame of an animation requires all frames before it, so that a
#: block of frames is decoded at a time; this is 27 frames of 640x480 in four channels
BLOCK = 32 << 20
MOST_UNPACKED = 1 << 30  #: bytes; an entry of an archive that states a larger size is not unpacked


def page_count(path: Path) -> int:
    """The number of pages of a file; 1 if it has no pages or cannot be read."""
    if not is_file(path):  # reading a pipe would block
        return 1
    try:
        with path.open("rb") as stream:
            return _count(stream, path)
    except OSError:
        return 1


def page_count_in(archive: zipfile.ZipFile, entry: str) -> int:
    """The number of pages of an entry of an archive; 1 if it has no pages or cannot be read."""
    try:
        if archive.getinfo(entry).file_size > MOST_UNPACKED:
            return 1
        with archive.open(entry) as stream:
            return _count(stream, None)
    except (OSError, zipfile.BadZipFile, KeyError, RuntimeError, EOFError, ValueError, zlib.error):
        return 1


def _count(stream: BinaryIO | IO[bytes], path: Path | None) -> int:
    """The number of pages in a stream; `path` is that of its file, if it has one."""
    head = stream.read(64)
    if head.startswith(PNG):
        return max(1, _png_frames(stream))
    if head[:2] not in (b"II", b"MM") and not _is_animation(head):
        return 1
    if path is not None:
        return _counted(path)
    with TemporaryDirectory(prefix="camcal-") as folder:  # cv2 counts pages only in files on disk
        copy = Path(folder, "pages")
        copy.write_bytes(head + stream.read())
        return _counted(copy)


def _counted(path: Path) -> int:
    try:
        return max(1, int(cv2.imcount(str(path), FLAGS)))
    except cv2.error:
        return 1


def read_page(data: bytes, number: int, flags: int = FLAGS) -> Array:
    """One page (height, width) or (height, width, channels); frames of animations as they are stored.

    Parameters
    ----------
    data : bytes
        The file.
    number : int
    flags : int
        Flags of `cv2.imdecodemulti`, for TIFF files.

    Raises
    ------
    UnreadableError
        If there is no such page, or it is damaged.
    """
    check_size(data)
    try:
        if data.startswith(PNG) or _is_animation(data[:64]):
            page = _frame(data, number)
        else:
            done, pages = cv2.imdecodemulti(np.frombuffer(data, np.uint8), flags, range=(number, number + 1))
            page = pages[0] if done and len(pages) else None
    except cv2.error as error:
        raise UnreadableError(f"page {number} cannot be decoded: {str(error.err).strip()[:80]}") from error
    if page is None or not page.size:
        raise UnreadableError(f"page {number} is damaged or missing")
    return page


def _is_animation(head: bytes) -> bool:
    """Return whether a file begins like an animated WebP (RFC 9649, 2.7) or AVIF (brand `avis`) file."""
    return (head[:4] == b"RIFF" and head[8:12] == b"WEBP" and b"ANIM" in head) or head[4:12] == b"ftypavis"


def _png_frames(stream: BinaryIO | IO[bytes]) -> int:
    """The number of frame control chunks of an animated PNG file (PNG, third edition, 11.3.6); 0 if it is none.

    They are counted because the number stated in the file is unreliable.
    """
    count, animated, at = 0, False, len(PNG)
    while True:
        stream.seek(at)
        head = stream.read(8)
        if len(head) < 8:
            return count
        length, kind = struct.unpack(">I4s", head)
        if kind == b"IEND" or (kind == b"IDAT" and not animated):
            return count
        animated |= kind == b"acTL"
        count += kind == b"fcTL"
        at += 12 + length


class _Block(NamedTuple):
    """Consecutive frames of an animation, identified by its SHA-256."""

    sha256: bytes
    start: int
    frames: tuple[Array, ...]


_block = [_Block(b"", 0, ())]


def _frame(data: bytes, number: int) -> Array | None:
    """A frame of an animation; None if it does not exist."""
    if not hasattr(cv2, "imdecodeanimation"):
        raise UnreadableError(
            "this version of OpenCV cannot read animations: upgrade it, or convert the file to pictures"
        )
    sha256 = hashlib.sha256(data).digest()
    kept = _block[0]
    if kept.sha256 != sha256 or not 0 <= number - kept.start < len(kept.frames):
        width, height = check_size(data) or (1, 1)
        count = max(1, BLOCK // (4 * width * height))
        done, animation = cv2.imdecodeanimation(np.frombuffer(data, np.uint8), number, count)
        kept = _block[0] = _Block(sha256, number, tuple(animation.frames) if done else ())
    return kept.frames[number - kept.start] if kept.frames else None
