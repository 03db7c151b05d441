"""Sources of pictures: a file, an entry of an archive, a page of a picture, a frame of a film.

Each has a name that is a path: `left.png`, `pictures.zip/left.png`, `all.tif#2`, `movie.mp4#123`. Pages and frames
are counted from 0. Whoever has the name can read the picture again.
"""

from __future__ import annotations

import hashlib
import re
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from camcal.detect.decode import UnreadableError, as_gray, decode_gray
from camcal.detect.exif import UNKNOWN, Taken, read_exif
from camcal.detect.frames import is_film, read_frame
from camcal.detect.pages import MOST_UNPACKED, read_page
from camcal.errors import DataError
from camcal.system.reading import read_file

Array = np.ndarray

ARCHIVES = (".zip",)
#: raw pictures of cameras: cv2 would read the small preview in some of them
RAW = (".dng", ".cr2", ".cr3", ".nef", ".nrw", ".arw", ".orf", ".rw2", ".raf", ".pef", ".srw")
MOST_BYTES = 2 << 30  #: of a picture's file: more than 200 million pixels of three 16-bit colours


def read_gray(path: Path, sha256: str | None = None) -> tuple[Array, str]:
    """A picture in grey, and the SHA-256 of its file (of the pixels, for a frame of a film).

    Parameters
    ----------
    path : Path
        A name as in the module's description.
    sha256 : str, optional
        What the hash was before: a picture that has changed is refused. A frame that came out otherwise is
        looked for again from the start of its film, because not every film can be entered at any frame.

    Raises
    ------
    UnreadableError
        With the reason.
    """
    file, number = split(path)
    fetched = fetch(path)
    if fetched.sha256 != sha256 is not None and number is not None and is_film(file):
        fetched = of_pixels(read_frame(file, number, from_start=True))
    if fetched.sha256 != sha256 is not None:
        raise UnreadableError(f"'{path}' has changed since the corners were found")
    return fetched.decode(), fetched.sha256


class Fetched(NamedTuple):
    """A picture that is not decoded yet.

    Attributes
    ----------
    sha256 : str
        Of its file (with the number of a page), or of the pixels of a frame.
    decode : callable
        Gives the grey picture, or raises UnreadableError.
    taken : Taken
        What the file says of the camera.
    """

    sha256: str
    decode: Callable[[], Array]
    taken: Taken = UNKNOWN


def fetch(path: Path) -> Fetched:
    """Read the file of a picture.

    Raises
    ------
    UnreadableError
        Where it cannot be read.
    """
    file, number = split(path)
    if number is not None and is_film(file):
        return of_pixels(read_frame(file, number))
    if file.suffix.lower() in RAW:
        raise UnreadableError(f"it is a raw camera file ({file.suffix}): export it to TIFF or PNG")
    data = read_bytes(file)
    if number is None:
        return Fetched(hashlib.sha256(data).hexdigest(), lambda: decode_gray(data), read_exif(data))
    page = hashlib.sha256(data + f"#{number}".encode()).hexdigest()
    return Fetched(page, lambda: as_gray(read_page(data, number)))


def split(path: Path) -> tuple[Path, int | None]:
    """The file of a page or a frame, and its number; `(path, None)` for anything else."""
    found = re.fullmatch(r"(.+)#(\d{1,9})", path.name)
    if found is None or path.exists():
        return path, None
    file = path.with_name(found[1])
    known = file.exists() or is_film(file) or archive_of(file) is not None
    return (file, int(found[2])) if known else (path, None)


def is_frame(path: Path) -> bool:
    """Return whether a name is that of a frame of a film."""
    file, number = split(path)
    return number is not None and is_film(file)


def archive_of(path: Path) -> Path | None:
    """The archive that contains a name, or None."""
    return next((p for p in path.parents if p.suffix.lower() in ARCHIVES and p.is_file()), None)


def exists(path: Path) -> bool:
    """Return whether such a file, entry, page or frame exists (the number itself is not checked)."""
    file, _ = split(path)
    archive = archive_of(file)
    if archive is None:
        return file.exists() or (is_film(file) and file.parent.is_dir())
    try:
        with zipfile.ZipFile(archive) as opened:
            return file.relative_to(archive).as_posix() in opened.namelist()
    except (OSError, zipfile.BadZipFile):
        return False


def read_bytes(path: Path) -> bytes:
    """The bytes of a file, or of an entry of an archive.

    Raises
    ------
    UnreadableError
        With the reason.
    """
    archive = archive_of(path)
    try:
        if archive is None:
            return read_file(path, MOST_BYTES, "a picture")
        with zipfile.ZipFile(archive) as opened:
            entry = opened.getinfo(path.relative_to(archive).as_posix())
            if entry.file_size > MOST_UNPACKED:
                raise UnreadableError(f"it would have {entry.file_size:,} bytes when unpacked")
            return opened.read(entry)
    except DataError as error:
        raise UnreadableError(f"it cannot be read: {error.message.rstrip('.')}") from error
    except OSError as error:
        raise UnreadableError(f"it cannot be read: {error.strerror or error}") from error
    except (zipfile.BadZipFile, KeyError, RuntimeError, EOFError, ValueError, zlib.error) as error:
        raise UnreadableError(f"the archive '{archive}' cannot be read: {error}") from error


def of_pixels(gray: Array) -> Fetched:
    """A picture that was decoded already; its SHA-256 is that of its size and pixels."""
    head = repr((gray.shape, gray.dtype.str)).encode()
    return Fetched(hashlib.sha256(head + gray.tobytes()).hexdigest(), lambda: gray)
