"""Pictures of a calibration target -> correspondences."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from camcal.data.observations import Observations, SkippedView, View
from camcal.detect import cache as cache_files
from camcal.detect import targets
from camcal.detect.decode import UnreadableError
from camcal.detect.examine import Outcome, Task, examine
from camcal.detect.exif import Taken
from camcal.detect.films import Range, Shown, candidates, left_out
from camcal.detect.frames import is_film
from camcal.detect.listing import list_pictures, view_ids
from camcal.detect.recognition.decide import Answer, answers, board_size, contradiction, unread, words
from camcal.detect.recognition.families import family_of, read_markers
from camcal.detect.recognition.look import Sight
from camcal.detect.recognition.measure import measured
from camcal.detect.sources import read_gray
from camcal.detect.targets.base import DEFAULT_SECONDS, Target
from camcal.detect.targets.checkerboard import Checkerboard
from camcal.detect.targets.circles import Circles
from camcal.detect.targets.tag_board import TagBoard
from camcal.detect.workers import map_unordered
from camcal.errors import DataError, UsageError
from camcal.settings.detection import DEFAULT_FRAMES
from camcal.settings.sizes import parse_grid, parse_length

#: called with (what happens, details) as the work goes on
OnEvent = Callable[[str, Mapping[str, Any]], None]

MOST_REASONS = 3  #: that are named where no picture shows the target
FIRST_LOOK = 12  #: pictures, spread over all, in which every kind of target is looked for at first
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
        Search every so many frames, in place of the sharpest and stillest ones.
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
    run = _Run(list_pictures(paths), seconds, jobs, folder, on_event)
    run.open_films(Range(from_time or 0.0, np.inf if to_time is None else to_time, every))
    run.tell("pictures", count=len(run.files))
    if wanted is None:
        target, outcomes = _recognised(run, square)
    else:
        target, outcomes = wanted, run.examine_all(run.files, wanted)
        _confirm(run, target, outcomes)
    outcomes = _kept(run, target, outcomes, keep_frames)
    run.tell_pictures(outcomes)
    return _correspondences(outcomes, target, wanted is None, run)


class _Run:
    """One call of `detect_images`: what all its pictures share."""

    def __init__(
        self,
        files: list[Path],
        seconds: float,
        jobs: int | None,
        cache: Path | None,
        on_event: OnEvent | None,
    ):
        self.files, self.seconds, self.jobs, self.cache, self.on_event = files, seconds, jobs, cache, on_event
        self.cache_told = False
        self.motion: dict[Path, float] = {}  # of each frame of a film
        self.frame_count = 0
        self.unreadable: list[Outcome] = []

    def open_films(self, chosen: Range) -> None:
        """Put the frames that are worth searching in the place of films."""
        files = []
        for path in self.files:
            if not is_film(path):
                files.append(path)
                continue
            try:
                found, count = candidates(path, chosen, partial(self._tell_film, path))
            except UnreadableError as error:
                self.unreadable.append(Outcome(path, "unreadable", str(error)))
                continue
            names = {path.with_name(f"{path.name}#{c.number}"): c.motion for c in found}
            self.motion |= names
            self.frame_count += count
            files += names
            self.tell("frames", path=path, frames=count, searched=len(names))
        self.files = files
        if not files:
            raise _nothing_found("target", self.unreadable, None, self)

    def _tell_film(self, path: Path, done: int, count: int) -> None:
        self.tell("film", path=path, done=done, count=count)

    @property
    def ids(self) -> dict[Path, str]:
        """What each picture is called in the report."""
        names = [*self.files, *(o.path for o in self.unreadable)]
        return dict(zip(names, view_ids(names), strict=True))

    @property
    def noun(self) -> str:
        """What was searched, in words."""
        return "frames" if self.motion and len(self.motion) == len(self.files) else "pictures"

    @property
    def count(self) -> str:
        """How many pictures or frames were searched, in words."""
        number = len(self.files) + len(self.unreadable)
        if self.noun == "frames":
            return f"{number} of {self.frame_count} frames"
        return f"{number} picture{'s' * (number != 1)}" + " and frames" * bool(self.motion)

    def tell(self, name: str, **details: Any) -> None:
        if self.on_event is not None:
            self.on_event(name, details)

    def examine_all(self, files: list[Path], target: Target | None) -> list[Outcome]:
        """Outcomes in the order of the files."""
        outcomes: list[Outcome | None] = [None] * len(files)
        done_by = map_unordered(examine, self._tasks(files, target), self.jobs, _crashed, len(files))
        for done, (index, outcome) in enumerate(done_by, 1):
            outcomes[index] = outcome
            if outcome.cache_error and not self.cache_told:
                self.cache_told = True
                self.tell("cache", reason=outcome.cache_error)
            self.tell("searched", done=done, count=len(files))
        return [o for o in outcomes if o is not None]

    def _tasks(self, files: list[Path], target: Target | None) -> Iterator[Task]:
        """A task for each picture; frames are decoded here, one after the other."""
        for path in files:
            gray = self.read(path) if path in self.motion else None
            yield Task(path, target, self.seconds, self.cache, gray)

    def tell_pictures(self, outcomes: list[Outcome]) -> None:
        """Say what came out of each picture."""
        ids = self.ids
        for done, o in enumerate(outcomes, 1):
            values = {"status": o.status, "reason": o.reason, "cached": o.cached}
            self.tell("picture", id=ids[o.path], done=done, count=len(outcomes), **values)

    def read(self, path: Path) -> Any:
        """A picture in grey, or None where it cannot be read."""
        try:
            return read_gray(path)[0]
        except UnreadableError:
            return None


def _crashed(task: Task) -> Outcome:
    return Outcome(task.path, "unreadable", "the process that read it has died")


def _wanted(
    target: str | Target | None, board: str | tuple[int, int] | None, square: str | tuple[float, str] | None
) -> Target | None:
    """The target that the options name; None where it is to be found."""
    if target is not None and target != "checkerboard":
        if board is not None or square is not None:
            raise UsageError(
                "a target and a board were both given.",
                "Give the sizes with the target, as in checkerboard:9x6:25mm.",
            )
        return targets.make(target) if isinstance(target, str) else target
    if board is None:
        return None
    columns, rows = parse_grid(board) if isinstance(board, str) else board
    return Checkerboard(columns, rows, *_length(square))


def _length(square: str | tuple[float, str] | None) -> tuple[float, str]:
    if square is None:
        return 1.0, "square"
    value, unit = parse_length(square) if isinstance(square, str) else square
    return float(value), unit


def _recognised(run: _Run, square: str | tuple[float, str] | None) -> tuple[Target, list[Outcome]]:
    """The target that most pictures show, and what was found of it in each.

    A few pictures are looked at first. Where these agree on markers or discs, the others are searched for that
    target only; a checkerboard's size is decided by all of them.
    """
    first = spread(run.files, FIRST_LOOK)
    outcomes = {o.path: o for o in run.examine_all(first, None)}
    best = _best(list(outcomes.values()))
    plain = best is None or isinstance(best.target, Checkerboard)
    if plain or (best is not None and len(best.pictures) < ENOUGH_VOTES):
        rest = [f for f in run.files if f not in outcomes]
        outcomes |= {o.path: o for o in run.examine_all(rest, None)}
    looked = [outcomes[f] for f in run.files if f in outcomes]
    sights = [o.sight or Sight() for o in looked]
    best = _best(looked)
    number = unread(sights, best)
    if number:
        raise DataError(
            f"{number} of {len(looked)} pictures show a board whose squares hold markers that cannot be read.",
            "Name the board, as in --target charuco:9x7:40mm:20mm:4X4_100, or take sharper, larger pictures.",
        )
    if best is None:
        raise _nothing_found("target", looked, None, run)
    if isinstance(best.target, Checkerboard):
        return _as_checkerboard(run, looked, sights, square)
    target = _with_length(_measured(run, best, looked), square)
    _tell_target(run, target, best, looked, True)
    return target, run.examine_all(run.files, target)


def _best(outcomes: list[Outcome]) -> Answer | None:
    found = answers([o.sight or Sight() for o in outcomes])
    return found[0] if found else None


def _measured(run: _Run, best: Answer, looked: list[Outcome]) -> Target:
    if isinstance(best.target, Circles):
        return best.target
    pictures = [run.read(looked[i].path) for i in best.pictures]
    return measured(best.target, [p for p in pictures if p is not None])


def _as_checkerboard(
    run: _Run, looked: list[Outcome], sights: list[Sight], square: str | tuple[float, str] | None
) -> tuple[Target, list[Outcome]]:
    """The size of a plain checkerboard from all pictures; those that showed something else are searched again."""
    found = board_size(sights)
    shown = [s.board for s in sights if s.board and not s.marked]
    if found is None:
        sizes = ", ".join(f"{c}x{r} ({n})" for (c, r), n in Counter(shown).most_common(MOST_REASONS))
        (columns, rows), _ = Counter(shown).most_common(1)[0]
        raise DataError(
            f"{len(shown)} of {len(looked)} pictures show a checkerboard, but too few show its end, "
            f"and they do not agree on its size: {sizes}.",
            f"Say its size in inner corners, as in --board {columns}x{rows}.",
        )
    size, whole, votes = found
    target = Checkerboard(*size, *_length(square))
    answer = Answer(target, tuple(range(votes)))
    _tell_target(run, target, answer, looked, whole)
    certain = [o.sight is not None and o.sight.board == size and (o.sight.whole or not whole) for o in looked]
    again = [
        o.path for o, sure in zip(looked, certain, strict=True) if o.sight and o.sight.board and not sure
    ]
    new = {o.path: o for o in run.examine_all(again, target)} if again else {}
    return target, [new.get(o.path, o) for o in looked]


def _tell_target(run: _Run, target: Target, best: Answer, looked: list[Outcome], whole: bool) -> None:
    """Say what was recognised, and what else pictures show."""
    sights = [o.sight or Sight() for o in looked]
    rest = [
        a for a in answers(sights) if type(a.target) is not type(target) or not same_size(a.target, target)
    ]
    others = [f"{words(a.target)} ({len(a.pictures)})" for a in rest if isinstance(target, type(a.target))]
    found = {"spec": target.spec, "words": words(target), "pictures": len(best.pictures), "of": len(looked)}
    run.tell("target", **found, whole=whole, others=others, noun=run.noun)


def same_size(one: Target, other: Target) -> bool:
    """Whether two targets have the same columns and rows, and the same first marker where they have any."""
    start = getattr(one, "start", 0) == getattr(other, "start", 0)
    return (one.columns, one.rows) == (other.columns, other.rows) and start


def spread(files: list[Path], count: int) -> list[Path]:
    """At most `count` files, evenly spread over all."""
    if len(files) <= count:
        return list(files)
    return [files[i * len(files) // count] for i in range(count)]


def _with_length(target: Target, square: str | tuple[float, str] | None) -> Target:
    return target if square is None else target.scaled(*_length(square))


def _confirm(run: _Run, target: Target, outcomes: list[Outcome]) -> None:
    """Refuse a board of markers that is not the one in the pictures.

    Raises
    ------
    DataError
        With the spec of the board that they show.
    """
    if not isinstance(target, TagBoard):
        return
    readable = [o.path for o in outcomes if o.status != "unreadable"]
    first = family_of(target.dictionary, target.border)
    pictures, sights = [], []
    for path in spread(readable, CONFIRMED_IN):
        gray = run.read(path)
        if gray is not None:
            family, markers = read_markers(gray, first)
            pictures.append(gray)
            sights.append(Sight(family, tuple(markers)))
    other = contradiction(target, sights, pictures)
    if other is not None:
        raise DataError(
            f"the pictures show {words(other)}; {words(target)} was asked for.", f"Try: --target {other.spec}"
        )


def _kept(run: _Run, target: Target, outcomes: list[Outcome], count: int | None) -> list[Outcome]:
    """The outcomes, the detections of frames that are not kept taken out, and films that cannot be read."""
    shown, places = [], []
    for place, o in enumerate(outcomes):
        if o.detection is not None and o.size is not None and o.path in run.motion:
            points = target.points[o.detection.point_ids, :2]
            shown.append(Shown(o.path.name, points, o.detection, o.size, run.motion[o.path]))
            places.append(place)
    chosen = left_out(shown, count) if shown and count is not None else {}
    reasons = {places[i]: reason for i, reason in chosen.items()}
    kept = [
        replace(o, status="rejected", reason=reasons[i], detection=None) if i in reasons else o
        for i, o in enumerate(outcomes)
    ]
    return kept + run.unreadable


def _correspondences(outcomes: list[Outcome], target: Target, detected: bool, run: _Run) -> Observations:
    ids = run.ids
    found = [o for o in outcomes if o.detection is not None]
    if not found:
        what = f"{target.columns}x{target.rows} {target.kind}"
        raise _nothing_found(what, outcomes, _seen_instead(run, target), run)
    size = Counter(o.size for o in found).most_common(1)[0][0]
    camera = _commonest_camera([o.taken for o in found if o.size == size])
    _tell_turned(run, found)
    views, skipped = [], []
    for o in outcomes:
        if o.detection is None:
            skipped.append(SkippedView(ids[o.path], o.status, o.reason))
        elif o.size != size:
            skipped.append(SkippedView(ids[o.path], "rejected", _other_size(o.size, size)))
        elif camera is not None and _other_camera(o.taken, camera):
            reason = f"it was taken by {o.taken}, most of the others by {camera}: calibrate each camera alone"
            skipped.append(SkippedView(ids[o.path], "rejected", reason))
        else:
            d = o.detection
            views.append(View(ids[o.path], target.points[d.point_ids], d.uv, d.sigma, d.point_ids))
    files = tuple({"path": str(o.path), "sha256": o.sha256} for o in outcomes)
    quality = {ids[o.path]: o.quality for o in outcomes if o.quality}
    described = {**target.describe(), "detected": detected}
    return Observations.from_views(
        views, size, target=described, skipped=tuple(skipped), files=files, picture_quality=quality
    )


def _commonest_camera(taken: list[Taken]) -> Taken | None:
    """Camera, focal length and zoom of most pictures that say so; None where none does."""
    known = Counter(replace(t, orientation=1) for t in taken if t.camera or t.focal)
    return known.most_common(1)[0][0] if known else None


def _other_camera(taken: Taken, camera: Taken) -> bool:
    """Whether a picture says that it is of another camera, focal length or zoom; one that says nothing is not."""
    named = bool(taken.camera and camera.camera) and taken.camera != camera.camera
    focal = bool(taken.focal and camera.focal) and abs(taken.focal / camera.focal - 1) > SAME_FOCAL
    return named or focal or taken.zoom != camera.zoom


def _tell_turned(run: _Run, found: list[Outcome]) -> None:
    """Say where pictures were held another way: they are used as the sensor saw them."""
    turned = sum(o.taken.orientation != 1 for o in found)
    if turned:
        run.tell("turned", count=turned, of=len(found))


def _other_size(found: tuple[int, int] | None, needed: tuple[int, int] | None) -> str:
    words = ["x".join(map(str, s or ())) for s in (found, needed)]
    said = f"the picture has {words[0]} pixels, most of the others {words[1]}"
    if found and needed and found == needed[::-1]:
        said += ": it was turned by a program; take the file as the camera wrote it"
    return said


def _seen_instead(run: _Run, target: Target) -> Answer | None:
    """What the pictures show in place of the target that was asked for."""
    looked = run.examine_all(spread(run.files, FIRST_LOOK), None)
    best = _best(looked)
    if best is None or (type(best.target) is type(target) and same_size(best.target, target)):
        return None
    shown = best.target.scaled(target.square, target.unit)
    return Answer(shown, best.pictures)


def _nothing_found(what: str, outcomes: list[Outcome], seen: Answer | None, run: _Run) -> DataError:
    """The error for a set of pictures without the target, with the commonest reasons as its hint."""
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
