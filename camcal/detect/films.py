"""Selection of the frames of a film: which to search, and which of those with the target to keep.

A film is read once from start to end, one frame at a time. In each interval of frames the sharpest frame with the least
motion is searched for the target; of the frames that show it, those are kept that together determine the camera best
(`view_information.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np

from camcal.detect.frames import MOST_FRAMES, Film
from camcal.detect.targets.base import Detection
from camcal.detect.view_information import chosen_views, information
from camcal.errors import DataError
from camcal.records import dataclass

Array = np.ndarray

MOST_SEARCHED = 240  #: frames of a film that are searched; a search takes about as long as decoding 50 frames
JUDGED = 8  #: frames of an interval whose sharpness is measured; the others are skipped
WIDTH = 320  #: px; sharpness is measured at about this width, where noise and compression have no effect
#: px per frame; motion that halves the sharpness of a frame in comparisons: a shutter is open for about half a frame
HALF_AS_SHARP = 2.0
#: beginnings of the reasons of frames that are good but not needed
REPEATED, SURPLUS = "it shows the target where ", "it adds less than "
MOVED = 0.005  #: of the diagonal; a target of which every point moved by less gives no new view
#: times the blur of the sharpest quarter of the frames (their lower quartile); above it, corners are less than half as
#: accurate
BLURRED, SHARPER = 1.5, 25
LEAST_BLUR = 1.0  #: px (sigma); narrower edges are sharper than a pixel; no frame is omitted for less
#: of the motion from one frame to the next, px; the shift of points, by a rolling shutter and by the exposure time,
#: that no pose explains if all rows are read in about half of the frame time and the board covers half of them
UNEXPLAINED = 0.05


@dataclass(frozen=True)
class Range:
    """The range of frames to consider: seconds from the start, and the step between frames."""

    start: float = 0.0
    end: float = np.inf
    every: int | None = None


@dataclass(frozen=True)
class Candidate:
    """A frame to be searched.

    Attributes
    ----------
    number : int
        Counted from 0.
    motion : float
        px, from the previous frame.
    """

    number: int
    motion: float


def candidates(
    path: Path, chosen: Range, on_progress: Callable[[int, int], object] = lambda done, count: None
) -> tuple[list[Candidate], int]:
    """The frames of a film to search, and the number of its frames.

    With `every`, each `every`-th frame; otherwise the best of each interval, of which there are at most twice
    `MOST_SEARCHED` (if the film does not state its length, intervals are merged as it is read).

    Raises
    ------
    UnreadableError
        If no decoder opens the film.
    DataError
        If frames are selected by time and the film does not state its frame rate.
    """
    film = Film(path)
    first, last = _numbers(film, chosen)
    length = max(1, -(-min(film.count, last) // MOST_SEARCHED)) if film.count else 1
    best: dict[int, tuple[float, Candidate]] = {}
    before: tuple[int, Array | None] = (-2, None)
    try:
        while film.next < last:
            number = film.next
            place = number - first
            judged = chosen.every or max(1, length // JUDGED)
            # the previous frame is also read, to measure the motion
            if place < 0 or (place % judged and (chosen.every or (place + 1) % judged)):
                if not film.skip():
                    break
                continue
            gray = film.read()
            if gray is None:
                break
            small = _reduced(gray)
            motion = _motion(before[1], small) if before[0] == number - 1 else 0.0
            motion *= gray.shape[1] / small.shape[1]
            before = number, small
            if place % judged:
                continue
            score = sharpness(small) / (1 + motion / HALF_AS_SHARP)
            stretch = place if chosen.every else place // length
            if stretch not in best or score > best[stretch][0]:
                best[stretch] = score, Candidate(number, motion)
            if chosen.every is None and len(best) > 2 * MOST_SEARCHED:
                length *= 2
                best = _merged(best, first, length)
            on_progress(number + 1, film.count)
        return [c for _, (_, c) in sorted(best.items())], film.next
    finally:
        film.close()


def _numbers(film: Film, chosen: Range) -> tuple[int, int]:
    """The first frame of a range, and the one after the last."""
    if chosen.start <= 0 and chosen.end == np.inf:
        return 0, MOST_FRAMES
    if not film.rate:
        raise DataError(f"'{film.path}' has no frame rate.", "Omit --from and --to.")
    return round(chosen.start * film.rate), int(min(chosen.end * film.rate, MOST_FRAMES))


def _merged(
    best: dict[int, tuple[float, Candidate]], first: int, length: int
) -> dict[int, tuple[float, Candidate]]:
    """The best candidate of each interval after doubling the length of the intervals."""
    merged: dict[int, tuple[float, Candidate]] = {}
    for score, candidate in best.values():
        stretch = (candidate.number - first) // length
        if stretch not in merged or score > merged[stretch][0]:
            merged[stretch] = score, candidate
    return merged


def _reduced(gray: Array) -> Array:
    factor = max(1.0, gray.shape[1] / WIDTH)
    small = cv2.resize(gray, None, fx=1 / factor, fy=1 / factor, interpolation=cv2.INTER_AREA)
    return small.astype(np.float32)


def sharpness(small: Array) -> float:
    """The sharpness of a picture: the energy of its second derivatives relative to that of its first; 0 for a
    uniform picture.
    """
    along, across = np.diff(small, axis=1), np.diff(small, axis=0)
    first = float((along**2).mean() + (across**2).mean())
    second = float((np.diff(along, axis=1) ** 2).mean() + (np.diff(across, axis=0) ** 2).mean())
    return second / first if first > 0 else 0.0


def _motion(before: Array | None, now: Array) -> float:
    """The approximate motion between pictures, px: sum of absolute changes over sum of absolute gradients."""
    if before is None or before.shape != now.shape:
        return 0.0
    gradient = np.abs(np.diff(now, axis=1)).sum() + np.abs(np.diff(now, axis=0)).sum()
    return float(2 * np.abs(now - before).sum() / gradient) if gradient > 0 else 0.0


@dataclass(frozen=True)
class Shown:
    """A frame that shows the target: its points on the board and in the picture.

    `motion` is the motion of the frame, px.
    """

    name: str
    points: Array
    found: Detection
    size: tuple[int, int]
    motion: float


def left_out(shown: Sequence[Shown], count: int) -> dict[int, str]:
    """The frames that are not kept: index -> reason.

    Parameters
    ----------
    shown : sequence of Shown
        In the order of the film.
    count : int
        Largest number of frames to keep.
    """
    reasons: dict[int, str] = {}
    blur = np.array([s.found.info.get("blur_px", np.nan) for s in shown])
    sharp = np.nanpercentile(blur, SHARPER) if np.isfinite(blur).any() else np.inf
    for i in np.flatnonzero(blur > max(BLURRED * sharp, LEAST_BLUR)):
        reasons[int(i)] = (
            f"blurred: its edges are {blur[i]:.1f} px wide (sigma), those of other frames {sharp:.1f}"
        )
    kept = [i for i in range(len(shown)) if i not in reasons]
    gains = [information(shown[i].points, shown[i].found.uv, _sigma(shown[i]), shown[i].size) for i in kept]

    def same(a: int, b: int) -> bool:
        return _same_pose(shown[kept[a]], shown[kept[b]])

    order, repeated = chosen_views(gains, count, same)
    for a, b in repeated.items():
        reasons[kept[a]] = f"{REPEATED}{shown[kept[b]].name} does"
    for a in set(range(len(kept))) - set(order) - set(repeated):
        reasons[kept[a]] = f"{SURPLUS}the {len(order)} frames that are kept (--frames)"
    return reasons


def _sigma(shown: Shown) -> float:
    """The standard deviation of the points of a frame, px, from their fits and the motion."""
    fit = 0.1 if shown.found.sigma is None else float(np.median(shown.found.sigma))
    return float(np.hypot(fit, UNEXPLAINED * shown.motion))


def _same_pose(one: Shown, other: Shown) -> bool:
    """Return whether none of the points common to both frames has moved."""
    _, a, b = np.intersect1d(one.found.point_ids, other.found.point_ids, return_indices=True)
    if not len(a) or one.size != other.size:
        return False
    moved = np.linalg.norm(one.found.uv[a] - other.found.uv[b], axis=1).max()
    return bool(moved < MOVED * np.hypot(*one.size))
