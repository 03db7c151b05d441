"""Pictures from a film or a camera device: frames in which the scene is still and differs from the last picture."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import cv2
import numpy as np

from camcal.detect.frames import FASTEST, is_film
from camcal.errors import DataError
from camcal.system.writing import atomic_write

Array = np.ndarray

#: px; frames are compared at this width, which evens out noise
WIDTH = 64
#: grey levels of 256: a mean difference of two frames below it is noise. Noise of 5 levels leaves about 1 of pictures
#: of 320 x 240 at this width, less of larger ones.
STILL = 2.0
#: grey levels: a picture that differs by less from the last one shows the target in the same place
NEW = 6.0
#: s; interval at which frames are examined: a hand holds a target still for about half a second
STEP = 0.2


def is_source(path: Path) -> bool:
    """Return whether a path is a film or a device such as /dev/video0."""
    return path.is_char_device() or (path.is_file() and is_film(path))


class Selector:
    """Selects frames that are still and differ from the last selected one."""

    def __init__(self) -> None:
        self._before: Array | None = None
        self._kept: Array | None = None

    def wants(self, frame: Array) -> bool:
        """Return whether to keep a frame (height, width[, 3]); frames come in order."""
        gray = frame if frame.ndim == 2 else frame.mean(2)
        height = max(1, round(gray.shape[0] * WIDTH / gray.shape[1]))
        small = cv2.resize(gray.astype(np.float32), (WIDTH, height), interpolation=cv2.INTER_AREA)
        before, self._before = self._before, small
        if before is None or before.shape != small.shape or _apart(before, small) > STILL:
            return False
        if self._kept is not None and self._kept.shape == small.shape and _apart(self._kept, small) < NEW:
            return False
        self._kept = small
        return True


def _apart(a: Array, b: Array) -> float:
    return float(np.abs(a - b).mean())


class Grabber(threading.Thread):
    """Writes selected frames into a folder, which is watched as usual.

    Attributes
    ----------
    done : bool
        Whether the film is over, or the device gave no more frames.

    Raises
    ------
    DataError
        If the film or device cannot be opened.
    """

    def __init__(self, source: Path, folder: Path):
        super().__init__(daemon=True)
        self.capture = cv2.VideoCapture(str(source))
        if not self.capture.isOpened():
            raise DataError(
                f"'{source}' cannot be opened as a film or a camera.",
                "Check the name, and whether another program uses it.",
            )
        self.live = source.is_char_device()
        rate = self.capture.get(cv2.CAP_PROP_FPS)
        self.stride = max(1, round(STEP * rate)) if 0 < rate < FASTEST else 1
        self.folder, self.done = folder, False
        folder.mkdir(exist_ok=True)

    def run(self) -> None:
        """Read to the end."""
        selector, number = Selector(), 0
        last = 0.0
        while True:
            good, frame = self.capture.read()
            if not good or frame is None:
                break
            number += 1
            due = time.monotonic() - last >= STEP if self.live else number % self.stride == 0
            if due:
                last = time.monotonic()
                if selector.wants(frame):
                    # the name counts frames, so that a picture can be found again in its film
                    _, data = cv2.imencode(".png", frame)
                    atomic_write(self.folder / f"frame{number:06d}.png", data.tobytes(), force=True)
        self.capture.release()
        self.done = True
