"""The part of a picture around its target, which is kept from the search to the second pass.

Decoding a picture of 12 megapixels takes as long as fitting its corners again, and a set of such pictures takes more
memory than a small machine has. Their parts fit, as a board seldom fills its picture.
"""

from __future__ import annotations

import contextlib
import mmap
from typing import TypeAlias

import numpy as np

from camcal.detect.pyramid import grey_span, white_level
from camcal.records import dataclass

Array = np.ndarray

#: bytes of the parts that are kept, some 40 of pictures of 2 megapixels: the memory of a command is to stay 1.5 times
#: that of a script + 60 MB, and the search itself takes 40 MB more than the script
KEPT = 48 << 20


class OutsideError(Exception):
    """Raised if pixels are needed that a part does not have; it is caught within this package."""


@dataclass(frozen=True)
class Part:
    """A rectangle of a picture, with what the fits need to know of the rest.

    Attributes
    ----------
    pixels : (h, w) array
    left, top : int
        Its first column and row in the picture, px.
    shape : (height, width)
        Of the picture.
    white, span : float
        `white_level` and `grey_span` of the picture.
    """

    pixels: Array
    left: int
    top: int
    shape: tuple[int, ...]
    white: float
    span: float


#: a picture, or its part around the target
Picture: TypeAlias = Array | Part


def around(gray: Array, uv: Array, margin: float) -> Part:
    """The part of a picture (height, width) within `margin` px of the bounding box of points (N, 2); a view of it."""
    size = np.array(gray.shape[1::-1])
    left, top = np.clip(np.floor(uv.min(0) - margin), 0, size).astype(int).tolist()
    right, bottom = np.clip(np.ceil(uv.max(0) + margin) + 1, 0, size).astype(int).tolist()
    return Part(gray[top:bottom, left:right], left, top, gray.shape, white_level(gray), grey_span(gray))


def values(picture: Picture, column: Array, row: Array, used: Array) -> Array:
    """Grey values at pixels (...) of a picture where they are `used` (...); others have any value.

    Raises
    ------
    OutsideError
        If a part does not have one of them.
    """
    if isinstance(picture, Part):
        column, row, picture = column - picture.left, row - picture.top, picture.pixels
        inside = (column >= 0) & (row >= 0) & (column < picture.shape[1]) & (row < picture.shape[0])
        if not inside[used].all():
            raise OutsideError
    place = row * picture.shape[1] + column
    place[~used] = 0
    return np.asarray(picture.ravel()[place])


def white(picture: Picture) -> float:
    """The `white_level` of a picture."""
    return picture.white if isinstance(picture, Part) else white_level(picture)


def span(picture: Picture) -> float:
    """The `grey_span` of a picture."""
    return picture.span if isinstance(picture, Part) else grey_span(picture)


class Kept:
    """Parts of pictures by the SHA-256 of their files, which take at most `KEPT` bytes.

    Each lies in pages of its own, which the system has again once it is forgotten: memory from the heap would stay with
    the process, beside that of the calibration. Processes that are copied from this one have them, too.
    """

    def __init__(self) -> None:
        self.jobs: int | None = None  #: number of processes of the search, and of the second pass
        self._parts: dict[str, Part] = {}
        self._bytes = 0

    def begin(self, jobs: int | None) -> None:
        """Begin another search with the given number of processes."""
        self.jobs = jobs
        self.clear()

    @property
    def full(self) -> bool:
        """Whether there is no room for more."""
        return self._bytes >= KEPT

    def keep(self, sha256: str, part: Part) -> None:
        """Keep a copy of a part, unless there is no room or no memory for it."""
        pixels = part.pixels
        if not pixels.size or sha256 in self._parts:
            return
        if self._bytes + pixels.nbytes > KEPT:
            self._bytes = KEPT
            return
        with contextlib.suppress(OSError):  # there is no memory for it: the picture is decoded again
            own = np.frombuffer(mmap.mmap(-1, pixels.nbytes), pixels.dtype).reshape(pixels.shape)
            own[:] = pixels
            self._parts[sha256] = Part(own, part.left, part.top, part.shape, part.white, part.span)
            self._bytes += pixels.nbytes

    def get(self, sha256: str) -> Part | None:
        """The part that is kept of a picture."""
        return self._parts.get(sha256)

    def clear(self) -> None:
        """Forget all parts: the second pass has used them."""
        self._parts.clear()
        self._bytes = 0


#: of the last search
KEPT_PARTS = Kept()
