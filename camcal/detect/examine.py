"""Processing of one picture, from its file to the detections; runs in a worker process."""

from __future__ import annotations

from dataclasses import field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from camcal.detect import cache, targets
from camcal.detect.camera_pass import margin
from camcal.detect.decode import UnreadableError
from camcal.detect.exif import UNKNOWN, Taken
from camcal.detect.local_contrast import with_second_look
from camcal.detect.part import Part, around
from camcal.detect.quality import measure
from camcal.detect.recognition.families import Marker
from camcal.detect.recognition.look import Sight, look
from camcal.detect.sources import fetch, of_pixels
from camcal.detect.targets.base import Detection, Miss, Target
from camcal.records import dataclass
from camcal.version import __version__


@dataclass(frozen=True)
class Task:
    """The target to search for in a picture; `target` None means a target of any kind."""

    path: Path
    target: Target | None
    seconds: float
    cache: Path | None
    gray: np.ndarray | None = None  #: the picture, where it has been decoded already (a frame of a film)
    expected: tuple[int, int] | None = (
        None  #: plain board that other pictures show, if the target is not given
    )
    negative: bool = False  #: search for a target of any kind with black and white exchanged
    keep: bool = False  #: return the part of the picture around the target

    @property
    def detector(self) -> str:
        """A string that identifies everything on which the result depends besides the picture."""
        return f"{__version__} {cache.code()} cv2 {cv2.__version__} {self.target!r} {self.seconds:g}" + (
            " negative" * self.negative
        )


@dataclass(frozen=True)
class Outcome:
    """The result for one picture.

    Attributes
    ----------
    status : str
        `found`, `not_found`, `unreadable`, or `rejected` for a frame that is not kept.
    size : (width, height) or None
    board : (columns, rows) or None
        Size of the grid that was found instead of the requested one.
    taken : Taken
        Camera data stored in the file.
    part : Part or None
        The part of the picture around the target, for the second pass.
    sight : Sight or None
        What the picture shows, if a target of any kind was searched for.
    """

    path: Path
    status: str
    reason: str = ""
    sha256: str = ""
    size: tuple[int, int] | None = None
    detection: Detection | None = None
    board: tuple[int, int] | None = None
    sight: Sight | None = None
    code: str = ""
    quality: dict[str, Any] = field(default_factory=dict)
    taken: Taken = UNKNOWN
    cached: bool = False
    cache_error: str = ""
    part: Part | None = None


def examine(task: Task) -> Outcome:
    """Read a picture and search it for the target, or take both from the cache."""
    sha256 = ""
    try:
        fetched = fetch(task.path) if task.gray is None else of_pixels(task.gray)
        sha256 = fetched.sha256
        place = None if task.cache is None else cache.entry(task.cache, sha256, task.detector)
        known = None if place is None else _from_cache(place, task.path, sha256)
        if known is not None:
            return replace(known, taken=fetched.taken)
        gray = fetched.decode()
        outcome = replace(_look(task, gray, sha256), taken=fetched.taken)
        found = outcome.detection
        if task.keep and found is not None and len(found):
            outcome = replace(outcome, part=around(gray, found.uv, margin(found.info.get("sides"))))
    except UnreadableError as error:
        return Outcome(task.path, "unreadable", str(error), sha256)
    except (MemoryError, cv2.error) as error:
        if isinstance(error, cv2.error) and error.code != cv2.Error.StsNoMem:
            raise
        return Outcome(task.path, "unreadable", "there is not enough memory to process it", sha256)
    if (
        place is None or outcome.code == "time"
    ):  # a time-out depends on the load of the machine and is not cached
        return outcome
    return _into_cache(place, outcome)


def _look(task: Task, gray: np.ndarray, sha256: str) -> Outcome:
    size = (gray.shape[1], gray.shape[0])
    sight, result = None, None
    if task.target is None:
        shown = ~gray if task.negative else gray
        sight, result = with_second_look(
            shown, lambda: look(shown, task.seconds, task.expected), lambda seen: seen[0].undecided
        )
    else:
        result = targets.find(task.target, gray, task.seconds)
    if isinstance(result, Miss):
        seen = result.info.get("size")
        return Outcome(
            task.path, "not_found", result.message, sha256, size, board=seen, sight=sight, code=result.reason
        )
    quality = measure(gray, result)
    return Outcome(task.path, "found", "", sha256, size, result, sight=sight, quality=quality)


def _into_cache(place: Path, outcome: Outcome) -> Outcome:
    values: dict[str, Any] = {
        name: getattr(outcome, name) for name in ("status", "reason", "size", "board", "code", "quality")
    }
    values["sight"] = None if outcome.sight is None else _plain_sight(outcome.sight)
    arrays = {}
    found = outcome.detection
    if found is not None:
        arrays = {"point_ids": found.point_ids, "uv": found.uv}
        arrays |= {"sigma": found.sigma} if found.sigma is not None else {}
        arrays |= {k: v for k, v in found.info.items() if isinstance(v, np.ndarray)}
        values["info"] = {k: v for k, v in found.info.items() if not isinstance(v, np.ndarray)}
    error = cache.store(place, arrays, values)
    return outcome if error is None else replace(outcome, cache_error=error)


def _from_cache(place: Path, path: Path, sha256: str) -> Outcome | None:
    """The stored outcome; None if there is none or it is incomplete."""
    stored = cache.load(place)
    if stored is None:
        return None
    arrays, values = stored
    try:
        detection = None
        if values["status"] == "found":
            info = values["info"]
            if "rejected" in info:
                info["rejected"] = {int(k): v for k, v in info["rejected"].items()}
            info |= {k: v for k, v in arrays.items() if k not in ("point_ids", "uv", "sigma")}
            detection = Detection(arrays["point_ids"], arrays["uv"], arrays.get("sigma"), info)
        return Outcome(
            path,
            values["status"],
            values["reason"],
            sha256,
            _pair(values["size"]),
            detection,
            _pair(values["board"]),
            None if values["sight"] is None else _sight(values["sight"]),
            values["code"],
            values["quality"],
            cached=True,
        )
    except (KeyError, TypeError, ValueError, AttributeError):  # written by something else
        return None


def _plain_sight(sight: Sight) -> dict[str, Any]:
    more = [[family, _plain_markers(markers)] for family, markers in sight.more]
    return {**sight.__dict__, "markers": _plain_markers(sight.markers), "more": more}


def _plain_markers(markers: tuple[Marker, ...]) -> list[Any]:
    return [[m.id, np.asarray(m.corners).tolist()] for m in markers]


def _sight(values: dict[str, Any]) -> Sight:
    family, discs, squares = values["family"], values["discs"], values["squares"]
    return Sight(
        None if family is None else (str(family[0]), int(family[1])),
        _markers(values["markers"]),
        _pair(values["board"]),
        bool(values["whole"]),
        bool(values["marked"]),
        None if discs is None else (int(discs[0]), int(discs[1]), bool(discs[2])),
        None if squares is None else (int(squares[0]), int(squares[1]), float(squares[2])),
        tuple(((str(name), int(border)), _markers(found)) for (name, border), found in values["more"]),
        bool(values["mirrored"]),
    )


def _markers(values: list[Any]) -> tuple[Marker, ...]:
    return tuple(Marker(int(i), np.array(corners, float)) for i, corners in values)


def _pair(value: Any) -> tuple[int, int] | None:
    return None if value is None else (int(value[0]), int(value[1]))
