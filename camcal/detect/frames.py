"""Access to frames of films by number, for every film that cv2's video reader opens."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from camcal.detect.decode import UnreadableError, as_gray

Array = np.ndarray

#: extensions that identify films without opening the file
FILMS = (
    ".mp4", ".m4v", ".mov", ".avi", ".mkv", ".webm", ".mjpeg", ".mjpg", ".mpg", ".mpeg", ".m2v", ".mts",
    ".m2ts", ".ts", ".wmv", ".asf", ".flv", ".3gp", ".ogv", ".h264", ".264", ".hevc", ".y4m", ".gif", ".apng",
)  # fmt: skip
_NUMBERED = re.compile(r"%0?\d*d")
SKIPPED = 30  #: frames; a nearer one is reached by reading forward, which costs less than seeking
#: frames per second; cv2 returns larger rates (a time base, such as 90,000) if a film or a camera has none
FASTEST = 10_000
MOST_FRAMES = 1_000_000_000  #: cv2 returns counts above it, or below 0, if the film has none


def is_film(path: Path) -> bool:
    """Return whether a name has the extension of a film, or denotes numbered pictures such as `frame_%04d.png`."""
    return path.suffix.lower() in FILMS or (_NUMBERED.search(path.name) is not None and not path.exists())


class Film:
    """An open film, read sequentially.

    Attributes
    ----------
    count : int
        Number of frames that the film states, or 0 if it states none.
    rate : float
        Frames per second, or 0.
    """

    def __init__(self, path: Path):
        self.path, self.next, self._capture = path, 0, _opened(path)
        count, rate = (self._capture.get(p) for p in (cv2.CAP_PROP_FRAME_COUNT, cv2.CAP_PROP_FPS))
        self.count = int(count) if 0 < count < MOST_FRAMES else 0
        self.rate = float(rate) if 0 < rate < FASTEST else 0.0

    def skip(self) -> bool:
        """Skip one frame; return False at the end."""
        done = bool(self._capture.grab())
        self.next += done
        return done

    def read(self) -> Array | None:
        """The next frame in grey; None at the end."""
        frame = self.read_colour()
        return None if frame is None else as_gray(frame)

    def read_colour(self) -> Array | None:
        """The next frame (height, width, 3), blue first; None at the end."""
        done, frame = self._capture.read()
        self.next += bool(done)
        return frame if done and frame is not None and frame.size else None

    def seek(self, number: int) -> bool:
        """Go to a frame: by reading forward if it is near, otherwise directly if the film permits it."""
        if self.count and not 0 <= number - self.next <= SKIPPED:
            self._capture.set(cv2.CAP_PROP_POS_FRAMES, number)
            if round(self._capture.get(cv2.CAP_PROP_POS_FRAMES)) == number:
                self.next = number
                return True
            self.restart()
        if number < self.next:
            self.restart()
        return self.walk(number)

    def walk(self, number: int) -> bool:
        """Read forward to a frame."""
        while self.next < number:
            if not self.skip():
                return False
        return True

    def restart(self) -> None:
        """Go back to the first frame."""
        self.close()
        self._capture, self.next = _opened(self.path), 0

    def close(self) -> None:
        """Release the decoder."""
        self._capture.release()


def _opened(path: Path) -> cv2.VideoCapture:
    if _NUMBERED.search(path.name) is None:
        try:
            if path.exists() and not path.is_file():
                raise UnreadableError("it is not a regular file")
            path.open("rb").close()
        except OSError as error:
            raise UnreadableError(f"it cannot be read: {error.strerror or error}") from error
    capture = cv2.VideoCapture(str(path))
    if not capture.isOpened():
        raise UnreadableError("no decoder can open this film; convert it to MP4 (H.264) or to pictures")
    return capture


_last: list[Film] = []  # the film that was read last is kept open: frames are mostly requested in order


def read_frame(path: Path, number: int, from_start: bool = False, colour: bool = False) -> Array:
    """One frame in grey (height, width), or in colour (height, width, 3), blue first.

    Parameters
    ----------
    path : Path
    number : int
        Counted from 0.
    from_start : bool
        Read the film from its first frame: seeking in some films leads to another frame than the requested one.

    Raises
    ------
    UnreadableError
        If the film cannot be opened or has no such frame.
    """
    if not _last or _last[0].path != path:
        close_films()
        _last.append(Film(path))
    film = _last[0]
    if from_start:
        film.restart()
    there = film.walk(number) if from_start else film.seek(number)
    frame = film.read_colour() if there else None
    if frame is None:
        close_films()
        raise UnreadableError(f"the film has no frame {number}")
    return frame if colour else as_gray(frame)


def close_films() -> None:
    """Close the film that `read_frame` keeps open."""
    while _last:
        _last.pop().close()


def colour_frames(path: Path) -> Iterator[tuple[int, Array]]:
    """(number, picture (height, width, 3)) of every frame of a film, in order."""
    film = Film(path)
    try:
        while (frame := film.read_colour()) is not None:
            yield film.next - 1, frame
    finally:
        film.close()
