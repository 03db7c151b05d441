"""From pictures of a calibration target to correspondences."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from camcal.data.observations import Observations, SkippedView
from camcal.detect import cache as cache_files
from camcal.detect import several, targets
from camcal.detect.examine import Outcome
from camcal.detect.exif import Taken
from camcal.detect.film_motion import with_motion
from camcal.detect.films import Range, Shown, left_out
from camcal.detect.listing import list_pictures
from camcal.detect.recognition.decide import Answer, answers, board_size, contradiction, unread, words
from camcal.detect.recognition.families import family_of, read_markers, read_others
from camcal.detect.recognition.look import Sight
from camcal.detect.recognition.measure import measured
from camcal.detect.search_pictures import OnEvent, Search
from camcal.detect.several import Searched
from camcal.detect.targets.base import DEFAULT_SECONDS, Target
from camcal.detect.targets.checkerboard import Checkerboard
from camcal.detect.targets.circles import Circles
from camcal.detect.targets.tag_board import TagBoard
from camcal.errors import DataError, UsageError
from camcal.settings.detection import DEFAULT_FRAMES
from camcal.settings.sizes import parse_grid, parse_length

MOST_REASONS = 3  #: that are named where no picture shows the target
FIRST_LOOK = 12  #: pictures, spread over all, in which every kind of target is looked for at first
#: pictures looked at before these: where all show one whole plain board, no markers are looked for beside it in others
AGREEING = 4
ENOUGH_VOTES = 3  #: pictures that must show a target of markers or discs for the others not to be asked
SAME_FOCAL = 0.005  #: share by which focal lengths of one setting may differ; EXIF gives three digits
CONFIRMED_IN = 6  #: pictures in which the markers are compared with the target that was asked for


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
        recognised from all pictures together; of a checkerboard the longer side is the columns.
    board : str or (columns, rows), optional
        Inner corners of a checkerboard.
    square : str or (value, unit), optional
        Side of its squares; of a recognised target the length of its cell, all others in proportion.
    jobs : int, optional
        Processes; one per processor where there is enough to do.
    seconds : float
        Time that one picture may take.
    on_event : callable, optional
        Called with `("pictures", {count})`, `("searched", {done, count})` as pictures are searched,
        `("film", {path, done, count})` as a film is read and `("frames", {path, frames, searched})` after it,
        `("target", {spec, words, pictures, of, noun, whole, others})` where it was recognised,
        `("turned", {count, of})` where pictures have an EXIF orientation (they are used as the sensor saw them),
        `("picture", {id, status, reason, done, count, cached})` for each at the end, and `("cache", {reason})`
        where the cache cannot be written.
    cache : bool
        Whether results are kept and reused.
    keep_frames : int, optional
        How many frames of films are kept at most; None keeps every one that shows the target.
    every : int, optional
        Search every so many frames, instead of the sharpest and stillest ones.
    from_time, to_time : float, optional
        Seconds; the part of a film that is searched.

    Returns
    -------
    Observations
        A view for each picture with the target, the rest in `skipped`. All views are of the size that most
        of them have; the others are `rejected`.

    Raises
    ------
    DataError
        Where there are no pictures, none shows the target, or they show a board of markers other than the one
        asked for.
    UsageError
        Where the target is unknown or contradicts `board` or `square`.
    """
    wanted = _wanted(target, board, square)
    folder = cache_files.default_folder() if cache else None
    run = Search(list_pictures(paths), seconds, jobs, folder, on_event)
    run.open_films(Range(from_time or 0.0, np.inf if to_time is None else to_time, every))
    if not run.files:
        raise _nothing_found("target", run.unreadable, None, run)
    run.tell("pictures", count=len(run.files))
    if wanted:
        searched = [Searched(t, run.examine_all(run.files, t)) for t in wanted]
        _confirm(run, searched)
    else:
        searched = _recognised(run, square)
    searched = _kept(run, searched, keep_frames)
    run.tell_pictures(several.merged(searched))
    return _correspondences(searched, not wanted, run)


def _wanted(
    target: str | Target | None, board: str | tuple[int, int] | None, square: str | tuple[float, str] | None
) -> list[Target]:
    """The targets that the options name; empty if they are to be recognised."""
    if target is not None and target != "checkerboard":
        if board is not None or square is not None:
            raise UsageError(
                "both a target and a board were given.",
                "Give the sizes with the target, as in checkerboard:9x6:25mm.",
            )
        return targets.make_all(target) if isinstance(target, str) else [target]
    if board is None:
        return []
    columns, rows = parse_grid(board) if isinstance(board, str) else board
    return [Checkerboard(columns, rows, *_length(square))]


def _length(square: str | tuple[float, str] | None) -> tuple[float, str]:
    if square is None:
        return 1.0, "square"
    value, unit = parse_length(square) if isinstance(square, str) else square
    return float(value), unit


def _recognised(run: Search, square: str | tuple[float, str] | None) -> list[Searched]:
    """The target that most pictures show, and the detections of it in each; then further boards of markers.

    A few pictures are looked at first. Where these agree on markers or discs, the others are searched for that
    target only; a checkerboard's size is decided by all of them.
    """
    first = spread(run.files, AGREEING)
    outcomes = {o.path: o for o in run.examine_all(first, None)}
    board = _agreed([o.sight for o in outcomes.values()])
    first = [f for f in spread(run.files, FIRST_LOOK) if f not in outcomes]
    outcomes |= {o.path: o for o in run.examine_all(first, None, board)}
    best = _best(list(outcomes.values()))
    plain = best is None or isinstance(best.target, Checkerboard)
    if plain or (best is not None and len(best.pictures) < ENOUGH_VOTES):
        rest = [f for f in run.files if f not in outcomes]
        outcomes |= {o.path: o for o in run.examine_all(rest, None, board)}
    looked = [outcomes[f] for f in run.files if f in outcomes]
    sights = [o.sight or Sight() for o in looked]
    best = _best(looked)
    mirrored = sum(s.mirrored for s in sights)
    if mirrored > (0 if best is None else len(best.pictures)):
        raise DataError(
            f"{mirrored} of {len(looked)} pictures are mirror images: their markers can be read only after they are "
            "turned over.",
            "Turn off the mirror effect (a setting of front cameras and of video calls), or flip the files "
            "from left to right, all of them.",
        )
    number = unread(sights, best)
    if number:
        raise DataError(
            f"{number} of {len(looked)} pictures show a board whose squares hold markers that cannot be read.",
            "Specify the board, as in --target charuco:9x7:40mm:20mm:4X4_100, or take sharper, larger pictures.",
        )
    if best is None:
        raise _nothing_found("target", looked, None, run)
    if isinstance(best.target, Checkerboard):
        return [_as_checkerboard(run, looked, sights, square)]
    boards = [best, *several.further(best, answers(sights))]
    found = [_with_length(_measured(run, b, looked), square) for b in boards]
    _tell_target(run, found, best, looked, True)
    return [Searched(t, run.examine_all(run.files, t)) for t in found]


def _agreed(sights: list[Sight | None]) -> tuple[int, int] | None:
    """The size of the plain board that all of some pictures show whole, with no marker beside it."""
    boards = {s.board if s is not None and s.plain else None for s in sights}
    return boards.pop() if len(boards) == 1 and len(sights) == AGREEING else None


def _best(outcomes: list[Outcome]) -> Answer | None:
    found = answers([o.sight or Sight() for o in outcomes])
    return found[0] if found else None


def _measured(run: Search, best: Answer, looked: list[Outcome]) -> Target:
    if isinstance(best.target, Circles):
        return best.target
    pictures = [run.read(looked[i].path) for i in best.pictures]
    return measured(best.target, [p for p in pictures if p is not None])


def _as_checkerboard(
    run: Search, looked: list[Outcome], sights: list[Sight], square: str | tuple[float, str] | None
) -> Searched:
    """The size of a plain checkerboard from all pictures; pictures that showed something else are searched again."""
    found = board_size(sights)
    shown = [s.board for s in sights if s.board and not s.marked]
    if found is None:
        sizes = ", ".join(f"{c}x{r} ({n})" for (c, r), n in Counter(shown).most_common(MOST_REASONS))
        (columns, rows), _ = Counter(shown).most_common(1)[0]
        raise DataError(
            f"{len(shown)} of {len(looked)} pictures show a checkerboard, but too few show its end, "
            f"and they do not agree on its size: {sizes}.",
            f"Give its size in inner corners, as in --board {columns}x{rows}.",
        )
    size, whole, votes = found
    target = Checkerboard(*size, *_length(square))
    answer = Answer(target, tuple(range(votes)))
    _tell_target(run, [target], answer, looked, whole)
    certain = [o.sight is not None and o.sight.board == size and (o.sight.whole or not whole) for o in looked]
    again = [
        o.path for o, sure in zip(looked, certain, strict=True) if o.sight and o.sight.board and not sure
    ]
    new = {o.path: o for o in run.examine_all(again, target)} if again else {}
    return Searched(target, [new.get(o.path, o) for o in looked])


def _tell_target(run: Search, found: list[Target], best: Answer, looked: list[Outcome], whole: bool) -> None:
    """Report the recognised target, and what else the pictures show."""
    sights = [o.sight or Sight() for o in looked]
    target = found[0]
    rest = [
        a
        for a in answers(sights)
        if not any(type(a.target) is type(t) and same_size(a.target, t) for t in found)
    ]
    others = [f"{words(a.target)} ({len(a.pictures)})" for a in rest if isinstance(target, type(a.target))]
    said = " and ".join(words(t) for t in found)
    spec = targets.BOTH.join(t.spec for t in found)
    details = {"spec": spec, "words": said, "pictures": len(best.pictures), "of": len(looked)}
    run.tell("target", **details, whole=whole, others=others, noun=run.noun)


def same_size(one: Target, other: Target) -> bool:
    """Return whether two targets have the same columns and rows, and the same first marker if they have markers."""
    start = getattr(one, "start", 0) == getattr(other, "start", 0)
    return (one.columns, one.rows) == (other.columns, other.rows) and start


def spread(files: list[Path], count: int) -> list[Path]:
    """At most `count` files, evenly spread over all."""
    if len(files) <= count:
        return list(files)
    return [files[i * len(files) // count] for i in range(count)]


def _with_length(target: Target, square: str | tuple[float, str] | None) -> Target:
    return target if square is None else target.scaled(*_length(square))


def _confirm(run: Search, searched: list[Searched]) -> None:
    """Raise an error if a board of markers is not the one in the pictures.

    Raises
    ------
    DataError
        With the spec of the board that they show.
    """
    target = searched[0].target
    if len(searched) > 1 or not isinstance(target, TagBoard):
        return  # several boards in the pictures explain each other's markers
    readable = [o.path for o in searched[0].outcomes if o.status != "unreadable"]
    first = family_of(target.dictionary, target.border)
    pictures, sights = [], []
    for path in spread(readable, CONFIRMED_IN):
        gray = run.read(path)
        if gray is not None:
            family, markers = read_markers(gray, first)
            pictures.append(gray)
            sights.append(Sight(family, tuple(markers), more=read_others(gray, family, markers)))
    other = contradiction(target, sights, pictures)
    if other is not None:
        raise DataError(
            f"the pictures show {words(other)}; {words(target)} was requested.", f"Try: --target {other.spec}"
        )


def _kept(run: Search, searched: list[Searched], count: int | None) -> list[Searched]:
    """The outcomes, without the detections of frames that are not kept, and the films that cannot be read."""
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
        raise _nothing_found(what, outcomes, _seen_instead(run, target), run)
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
                f"it was taken by {o.taken}, most of the others by {camera}: calibrate each camera separately"
            )
            skipped.append(SkippedView(ids[o.path], "rejected", reason))
        else:
            views += several.views_of(searched, number, ids[o.path])
    files = tuple({"path": str(o.path), "sha256": o.sha256} for o in outcomes)
    quality = {ids[o.path]: o.quality for o in outcomes if o.quality}
    described = {**several.described(searched), "detected": detected}
    return Observations.from_views(
        views, size, target=described, skipped=tuple(skipped), files=files, picture_quality=quality
    )


def _commonest_camera(taken: list[Taken]) -> Taken | None:
    """Camera, focal length and zoom of most pictures with such data; None if no picture has them."""
    known = Counter(replace(t, orientation=1) for t in taken if t.camera or t.focal)
    return known.most_common(1)[0][0] if known else None


def _other_camera(taken: Taken, camera: Taken) -> bool:
    """Return whether a picture has the data of another camera, focal length or zoom; one without data does not."""
    named = bool(taken.camera and camera.camera) and taken.camera != camera.camera
    focal = bool(taken.focal and camera.focal) and abs(taken.focal / camera.focal - 1) > SAME_FOCAL
    return named or focal or taken.zoom != camera.zoom


def _tell_turned(run: Search, found: list[Outcome]) -> None:
    """Report pictures that were held in another orientation; they are used as the sensor recorded them."""
    turned = sum(o.taken.orientation != 1 for o in found)
    if turned:
        run.tell("turned", count=turned, of=len(found))


def _other_size(found: tuple[int, int] | None, needed: tuple[int, int] | None) -> str:
    words = ["x".join(map(str, s or ())) for s in (found, needed)]
    said = f"the picture has {words[0]} pixels, most of the others {words[1]}"
    if found and needed and found == needed[::-1]:
        said += ": a program rotated it; use the original file of the camera"
    return said


def _seen_instead(run: Search, target: Target) -> Answer | None:
    """The target that the pictures show instead of the requested one."""
    looked = run.examine_all(spread(run.files, FIRST_LOOK), None)
    best = _best(looked)
    if best is None or (type(best.target) is type(target) and same_size(best.target, target)):
        return None
    shown = best.target.scaled(target.square, target.unit)
    return Answer(shown, best.pictures)


def _nothing_found(what: str, outcomes: list[Outcome], seen: Answer | None, run: Search) -> DataError:
    """The error for a set of pictures without the target, with the most frequent reasons as its hint."""
    run.tell_pictures(outcomes)
    message = f"no {what} was found in {run.count}."
    if seen is not None:
        number = len(seen.pictures)
        shown = f"{number} of the pictures show{'s' * (number == 1)} {words(seen.target)}."
        option = f"--target {seen.target.spec}"
        if isinstance(seen.target, Checkerboard):
            option = f"--board {seen.target.columns}x{seen.target.rows}"
        return DataError(message, f"{shown} Try: {option}")
    # reasons of one code differ in figures; those of files that cannot be read have no code
    example = {o.code or o.reason: o.reason for o in reversed(outcomes)}
    kinds = Counter(o.code or o.reason for o in outcomes).most_common(MOST_REASONS)
    said = "; ".join(f"{number} of {len(outcomes)}: {example[kind]}" for kind, number in kinds)
    return DataError(message, said + ".")
