"""Resampling of pictures through a map, and writing of the result, preserving colours and bit depth."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import cv2
import numpy as np

from camcal.data.writing import atomic_write
from camcal.detect.decode import UnreadableError, check_size, decode_gray, decoded, read_heic
from camcal.detect.frames import colour_frames, is_film, read_frame
from camcal.detect.pages import read_page
from camcal.detect.sources import read_bytes, split
from camcal.errors import DataError

Array = np.ndarray

INTERPOLATIONS = {
    "nearest": cv2.INTER_NEAREST,
    "linear": cv2.INTER_LINEAR,
    "cubic": cv2.INTER_CUBIC,
    "lanczos": cv2.INTER_LANCZOS4,
}
#: formats that are also written; pictures of other formats become PNG
WRITTEN = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp", ".ppm", ".pgm")
_FLAGS = cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION


def read_pictures(
    files: Iterable[Path], size: tuple[int, int] | None = None
) -> Iterator[tuple[Path, Array | UnreadableError]]:
    """The pixels (height, width) or (height, width, channels) of pictures as stored, or the reason why not.

    With `size`, a picture whose header states another size is not decoded. Each frame of a film is a picture of its
    own, as `movie.mp4#123`.
    """
    for path in files:
        try:
            if is_film(path):
                for number, frame in colour_frames(path):
                    yield path.with_name(f"{path.name}#{number}"), frame
            else:
                yield path, _read(path, size)
        except UnreadableError as reason:
            yield path, reason


def _read(path: Path, size: tuple[int, int] | None) -> Array:
    file, number = split(path)
    if number is not None and is_film(file):
        return read_frame(file, number, colour=True)
    data = read_bytes(file)
    stated = check_size(data)
    if None not in (size, stated) and stated != size:
        raise UnreadableError(other_size(stated, size))
    if number is not None:
        return read_page(data, number, _FLAGS)
    picture = decoded(np.frombuffer(data, np.uint8), _FLAGS)
    if picture is None:
        picture = read_heic(data)
    if picture is None:
        decode_gray(data)  # raises, with the reason
        raise UnreadableError("it is not a picture of a known format")
    return picture


def other_size(found: tuple[int, ...] | None, needed: tuple[int, int] | None) -> str:
    """The reason for skipping a picture whose size differs from the camera's."""
    words = ["x".join(map(str, size or ())) for size in (found, needed)]
    return f"it is {words[0]}, the camera was calibrated for {words[1]}"


def resample(picture: Array, u: Array, v: Array, interpolation: str = "linear") -> Array:
    """The picture sampled at (u, v), black where these are -1.

    Parameters
    ----------
    picture : (h, w) or (h, w, channels) array
    u, v : (height, width) float32 arrays
    interpolation : str
        One of `INTERPOLATIONS`.
    """
    outside = (u == -1) & (v == -1)
    # the border is replicated for the half pixel between the outermost pixel centres and the edge of the picture
    out = cv2.remap(picture, u, v, INTERPOLATIONS[interpolation], borderMode=cv2.BORDER_REPLICATE)
    out[outside] = 0
    return out


def written_name(path: Path) -> str:
    """The name of a resampled picture: `movie_000123.png` for a frame of a film."""
    file, number = split(path)
    if number is not None:
        return f"{file.stem}_{number:06d}.png"
    return path.name if path.suffix.lower() in WRITTEN else path.stem + ".png"


def write_picture(path: Path, picture: Array, force: bool = False) -> None:
    """Write a picture atomically, in the format of its extension.

    Raises
    ------
    DataError
        If the format cannot hold these pixels.
    """
    try:
        done, data = cv2.imencode(path.suffix, picture)
    except cv2.error as error:
        raise DataError(f"'{path}' cannot hold this picture: {str(error.err).strip()[:80]}.") from error
    if not done:
        raise DataError(f"'{path}' cannot hold this picture.", "Choose PNG or TIFF.")
    atomic_write(path, data.tobytes(), force)
