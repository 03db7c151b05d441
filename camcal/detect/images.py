"""From pictures of a calibration target to correspondences."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Sequence
from contextlib import nullcontext
from dataclasses import replace
from functools import partial

import numpy as np

from camcal.data.observations import Observations, SkippedView
from camcal.detect import cache as cache_files
from camcal.detect import several, targets
from camcal.detect.examine import Outcome
from camcal.detect.exif import Taken
from camcal.detect.film_motion import with_motion
from camcal.detect.films import Range, Shown, left_out
from camcal.detect.listing import left_in_folders, list_pictures
from camcal.detect.local_contrast import with_second_look
from camcal.detect.recognition.decide import Answer, contradiction, words
from camcal.detect.recognition.families import family_of, read_markers, read_others
from camcal.detect.recognition.look import Sight
from camcal.detect.recognition.marks import squares_hold_marks
from camcal.detect.recognition.measure import measured
from camcal.detect.search_pictures import OnEvent, Search
from camcal.detect.several import Searched
from camcal.detect.targets.base import DEFAULT_SECONDS, Target
from camcal.detect.targets.checkerboard import Checkerboard
from camcal.detect.targets.tag_board import TagBoard
from camcal.detect.unasked import (
    FIRST_LOOK,
    best_of,
    length_of,
    nothing_found,
    recognised,
    same_size,
    spread,
)
from camcal.errors import DataError, UsageError
from camcal.settings.detection import DEFAULT_FRAMES
from camcal.settings.sizes import parse_grid
from camcal.system.processes import one_opencv_thread

SAME_FOCAL = 0.005  #: relative difference of focal lengths that count as equal; EXIF gives three digits
CONFIRMED_IN = 6  #: pictures in which the markers are compared with the requested target


def detect_images(
    paths: Iterable[str | os.PathLike],
    target: str | Target | None = None,
    board: str | tuple[int, int] | None = None,
    square: str | tuple[float, str] | None = None,
    jobs: int | None = None,
    seconds: float = DEFAULT_SECONDS,
    on_event: OnEvent | None = None,
    cache: bool = True,
    keep_frames: int | None = DEFAULT_FRAMES,
    every: int | None = None,
    from_time: float | None = None,
    to_time: float | None = None,
) -> Observations:
    """Find a target in pictures.

    Parameters
    ----------
    paths : folders, files, patterns, zip archives, films, or `frame_%04d.png`
    target : str or Target, optional
        A spec such as `charuco:9x7:40mm:20mm:4X4_100`. Without it (and without `board`) the target is
        recognised from all pictures together; the longer side of a checkerboard is its columns.
    board : str or (columns, rows), optional
        Inner corners of a checkerboard.
    square : str or (value, unit), optional
        Side of its squares; for a recognised target the length of its cell, which scales all other lengths.
    jobs : int, optional
        Number of processes; by default one per processor if there is enough work.
    seconds : float
        Time that one picture may take.
    on_event : callable, optional
        See `camcal.detect.search_pictures.OnEvent`.
    cache : bool
        Whether results are kept and reused.
    keep_frames, every : int, optional
        Largest number of frames kept of films (None: every one that shows the target); search every n-th frame
        instead of the sharpest ones with the least motion.
    from_time, to_time : float, optional
        The part of a film that is searched, s.

    Returns
    -------
    Observations
        A view for each picture with the target, the rest in `skipped`. All views have the most frequent picture
        size; pictures of other sizes are `rejected`.

    Raises
    ------
    DataError
        If there are no pictures, none shows the target, or they show a board of markers other than the requested
        one.
    UsageError
        If the target is unknown or contradicts `board` or `square`.
    """
    wanted = _wanted(target, board, square)
    part = Range(from_time or 0.0, np.inf if to_time is None else to_time, every)
    # with one thread of OpenCV the process can be copied; alone, it searches large pictures faster with more
    with nullcontext() if jobs == 1 else one_opencv_thread():
        run = _opened(list(paths), part, seconds, jobs, cache, on_event)
        with run.workers:
            if wanted:
                searched = _in_negative(run, [Searched(t, run.examine_all(run.files, t)) for t in wanted])
                _confirm(run, searched)
            else:
                searched = recognised(run, square)
            searched = _kept(run, searched, keep_frames)
            run.tell_pictures(several.merged(searched))
            return _correspondences(searched, not wanted, run)


def _opened(
    paths: Sequence[str | os.PathLike],
    part: Range,
    seconds: float,
    jobs: int | None,
    cache: bool,
    on_event: OnEvent | None,
) -> Search:
    """Start a search of all files that the paths name, with films opened.

    Raises
    ------
    DataError
        If there are none.
    """
    run = Search(
        list_pictures(paths), seconds, jobs, cache_files.default_folder() if cache else None, on_event
    )
    left = left_in_folders(paths)
    if left:
        run.tell("left", files=left)
    run.open_films(part)
    if not run.files:
        raise nothing_found("target", run.unreadable, None, run)
    run.tell("pictures", count=len(run.files))
    return run


def _wanted(
    target: str | Target | None, board: str | tuple[int, int] | None, square: str | tuple[float, str] | None
) -> list[Target]:
    """The targets that the options name; empty if they are to be recognised."""
    if target is not None and target != "checkerboard":
        if board is not None or square is not None:
            raise UsageError(
                "a target and a board were given; one is needed.",
                "Give the sizes with the target, as in checkerboard:9x6:25mm.",
            )
        return targets.make_all(target) if isinstance(target, str) else [target]
    if board is None:
        return []
    columns, rows = parse_grid(board) if isinstance(board, str) else board
    return [Checkerboard(columns, rows, *length_of(square))]


def _in_negative(run: Search, searched: list[Searched]) -> list[Searched]:
    """What was found of the requested targets; if nothing, what is found with black and white exchanged."""
    if any(o.detection for each in searched for o in each.outcomes):
        return searched
    for each in searched:
        other = each.target.as_negative(not each.target.negative)
        if isinstance(other, Checkerboard):
            continue
        if any(o.detection for o in run.examine_all(spread(run.files, FIRST_LOOK), other)):
            outcomes = run.examine_all(run.files, other)
            run.tell("negative", spec=other.spec)
            return [Searched(other, outcomes)]
    return searched


def _confirm(run: Search, searched: list[Searched]) -> None:
    """Raise an error if the pictures show a board of markers other than the requested one.

    Raises
    ------
    DataError
        With the spec of the board in the pictures.
    """
    target = searched[0].target
    if isinstance(target, Checkerboard):
        _tell_marked(run, target, searched[0].outcomes)
    if len(searched) > 1 or not isinstance(target, TagBoard):
        return  # several boards in the pictures explain each other's markers
    readable = [o.path for o in searched[0].outcomes if o.status != "unreadable"]
    first = family_of(target.dictionary, target.border)
    pictures, sights = [], []
    for path in spread(readable, CONFIRMED_IN):
        gray = run.read(path, target.negative)
        if gray is not None:
            family, markers = with_second_look(
                gray, partial(read_markers, gray, first), lambda read: read[0] is None
            )
            pictures.append(gray)
            sights.append(Sight(family, tuple(markers), more=read_others(gray, family, markers)))
    other = contradiction(target, sights, pictures)
    if other is not None:
        other = other.as_negative(target.negative)
        raise DataError(
            f"the pictures show {words(other)}; {words(target)} was requested.", f"Try: --target {other.spec}"
        )


def _tell_marked(run: Search, target: Checkerboard, outcomes: list[Outcome]) -> None:
    """Report if one of the pictures shows that the requested checkerboard holds markers."""
    found = next((o for o in outcomes if o.detection is not None), None)
    gray = None if found is None else run.read(found.path)
    if found is None or found.detection is None or gray is None:
        return
    if squares_hold_marks(gray, found.detection, (target.columns, target.rows)):
        best = best_of(run.examine_all([found.path], None))
        if best is not None and isinstance(best.target, TagBoard):
            shown = measured(best.target, [gray]).scaled(target.square, target.unit)
            run.tell("marked", words=words(shown), spec=shown.spec)


def _kept(run: Search, searched: list[Searched], count: int | None) -> list[Searched]:
    """The outcomes without the detections of frames that are not kept; films that cannot be read are added."""
    target, outcomes = searched[0].target, searched[0].outcomes
    shown, places = [], []
    for place, o in enumerate(outcomes):
        if o.detection is not None and o.size is not None and o.path in run.motion:
            points = target.points[o.detection.point_ids, :2]
            shown.append(Shown(o.path.name, points, o.detection, o.size, run.motion[o.path]))
            places.append(place)
    chosen = left_out(shown, count) if shown and count is not None else {}
    reasons = {places[i]: reason for i, reason in chosen.items()}
    kept = [
        [
            replace(o, status="rejected", reason=reasons[i], detection=None) if i in reasons else o
            for i, o in enumerate(each.outcomes)
        ]
        for each in searched
    ]
    if len(searched) == 1 and run.motion:
        kept[0] = with_motion(kept[0], lambda files: run.examine_all(files, target), outcomes)
    return [replace(each, outcomes=left + run.unreadable) for each, left in zip(searched, kept, strict=True)]


def _correspondences(searched: list[Searched], detected: bool, run: Search) -> Observations:
    ids, target, outcomes = run.ids, searched[0].target, several.merged(searched)
    found = [o for o in outcomes if o.detection is not None]
    if not found:
        what = f"{target.columns}x{target.rows} {target.kind}"
        raise nothing_found(what, outcomes, _seen_instead(run, target), run)
    size = Counter(o.size for o in found).most_common(1)[0][0]
    camera = _commonest_camera([o.taken for o in found if o.size == size])
    _tell_turned(run, found)
    views, skipped = [], []
    for number, o in enumerate(outcomes):
        if o.detection is None:
            skipped.append(SkippedView(ids[o.path], o.status, o.reason))
        elif o.size != size:
            skipped.append(SkippedView(ids[o.path], "rejected", _other_size(o.size, size)))
        elif camera is not None and _other_camera(o.taken, camera):
            reason = (
                f"it was taken by {o.taken}, most of the others by {camera}; calibrate each camera separately"
            )
            skipped.append(SkippedView(ids[o.path], "rejected", reason))
        else:
            views += several.views_of(searched, number, ids[o.path])
    files = tuple({"path": str(o.path), "sha256": o.sha256, **_named(o.taken)} for o in outcomes)
    quality = {ids[o.path]: o.quality for o in outcomes if o.quality}
    described = {**several.described(searched), "detected": detected}
    return Observations.from_views(
        views, size, target=described, skipped=tuple(skipped), files=files, picture_quality=quality
    )


def _named(taken: Taken) -> dict[str, str]:
    """The camera of a picture for the report; empty where its file names none."""
    return {"taken": str(taken)} if taken.camera else {}


def _commonest_camera(taken: list[Taken]) -> Taken | None:
    """Camera, focal length and zoom of most pictures with such data; None if no picture has them."""
    known = Counter(replace(t, orientation=1) for t in taken if t.camera or t.focal)
    return known.most_common(1)[0][0] if known else None


def _other_camera(taken: Taken, camera: Taken) -> bool:
    """Return whether a picture has the data of another camera, focal length or zoom; False without data."""
    named = bool(taken.camera and camera.camera) and taken.camera != camera.camera
    focal = bool(taken.focal and camera.focal) and abs(taken.focal / camera.focal - 1) > SAME_FOCAL
    return named or focal or taken.zoom != camera.zoom


def _tell_turned(run: Search, found: list[Outcome]) -> None:
    """Report pictures taken with the camera rotated; they are used as the sensor recorded them."""
    turned = sum(o.taken.orientation != 1 for o in found)
    if turned:
        run.tell("turned", count=turned, of=len(found))


def _other_size(found: tuple[int, int] | None, needed: tuple[int, int] | None) -> str:
    words = ["x".join(map(str, s or ())) for s in (found, needed)]
    said = f"the picture has {words[0]} pixels, and most of the others {words[1]}"
    if found and needed and found == needed[::-1]:
        said += ": a program rotated it; use the original file of the camera"
    return said


def _seen_instead(run: Search, target: Target) -> Answer | None:
    """The target that the pictures show instead of the requested one."""
    looked = run.examine_all(spread(run.files, FIRST_LOOK), None)
    best = best_of(looked)
    if best is None or (type(best.target) is type(target) and same_size(best.target, target)):
        return None
    shown, pictures = best.target.scaled(target.square, target.unit), best.pictures
    if isinstance(shown, Checkerboard):  # of boards of several sizes, the most frequent one
        size = shown.columns, shown.rows
        pictures = tuple(i for i in pictures if (looked[i].sight or Sight()).board == size)
    return Answer(shown, pictures)
