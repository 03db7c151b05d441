"""The pictures of one search: frames, names, processing, and progress reports."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from camcal.detect import cache as cache_files
from camcal.detect.decode import UnreadableError
from camcal.detect.examine import Outcome, Task, examine
from camcal.detect.films import Range, candidates
from camcal.detect.frames import is_film
from camcal.detect.listing import view_ids
from camcal.detect.part import KEPT_PARTS
from camcal.detect.sources import is_frame, read_gray
from camcal.detect.targets.base import Target
from camcal.detect.workers import Workers
from camcal.errors import DataError

#: Called with an event and its details as the work proceeds:
#:
#: - `("pictures", {count})`, and `("searched", {done, count})` as they are searched;
#: - `("waiting", {})` once, when other processes have begun to search and this one waits for them;
#: - `("film", {path, done, count})` as a film is read, `("frames", {path, frames, searched})` after it;
#: - `("left", {files})` if folders of pictures contain films or raw pictures, which are not used;
#: - `("no-film", {})` if a part of a film was requested and there is no film;
#: - `("target", {spec, words, pictures, of, noun, whole, others})` if the target was recognised;
#: - `("marked", {words, spec})` if the requested checkerboard is a board of markers;
#: - `("negative", {spec})` if the requested target is found with black and white exchanged;
#: - `("turned", {count, of})` if pictures have an EXIF orientation (they are used as the sensor recorded them);
#: - `("picture", {id, status, reason, done, count, cached})` for each at the end;
#: - `("cache", {reason})` if the cache cannot be written.
OnEvent = Callable[[str, Mapping[str, Any]], None]


class Search:
    """One call of `detect_images`: the data that all its pictures share."""

    def __init__(
        self,
        files: list[Path],
        seconds: float,
        jobs: int | None,
        cache: Path | None,
        on_event: OnEvent | None,
    ):
        self.files, self.seconds, self.cache, self.on_event = files, seconds, cache, on_event
        self.cache_told = False
        self.motion: dict[Path, float] = {}  # of each frame of a film
        self.frame_count = 0
        self.unreadable: list[Outcome] = []
        self.workers = Workers(jobs, partial(self.tell, "waiting"))
        KEPT_PARTS.begin(jobs)
        cache_files.use(cache)

    def open_films(self, chosen: Range) -> None:
        """Replace films by their frames that are to be searched.

        Raises
        ------
        DataError
            If no frame is in the range.
        """
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
        if not files and not self.unreadable:
            limits = f"from {chosen.start:g} s" + f" to {chosen.end:g} s" * (chosen.end < np.inf)
            raise DataError(
                f"there are no frames {limits}.",
                "--from must be earlier than --to and than the end of the film.",
            )
        if chosen != Range() and not any(map(is_film, self.files)):
            self.tell("no-film")
        self.files = files

    def _tell_film(self, path: Path, done: int, count: int) -> None:
        self.tell("film", path=path, done=done, count=count)

    @property
    def ids(self) -> dict[Path, str]:
        """The id of each picture in the report."""
        names = [*self.files, *(o.path for o in self.unreadable)]
        return dict(zip(names, view_ids(names), strict=True))

    @property
    def noun(self) -> str:
        """A noun for what was searched."""
        return "frames" if self.motion and len(self.motion) == len(self.files) else "pictures"

    @property
    def count(self) -> str:
        """The number of pictures or frames searched, in words."""
        number = len(self.files) + len(self.unreadable)
        if self.noun == "frames":
            return f"{number} of {self.frame_count} frames"
        return f"{number} picture{'s' * (number != 1)}" + " and frames" * bool(self.motion)

    def tell(self, name: str, **details: Any) -> None:
        """Report progress to the caller."""
        if self.on_event is not None:
            self.on_event(name, details)

    def examine_all(
        self,
        files: list[Path],
        target: Target | None,
        expected: tuple[int, int] | None = None,
        negative: bool = False,
    ) -> list[Outcome]:
        """Outcomes in the order of the files; for `expected` and `negative` see `examine.Task`."""
        outcomes: list[Outcome | None] = [None] * len(files)
        tasks = self._tasks(files, target, expected, negative)
        done_by = self.workers.map_unordered(examine, tasks, _crashed, len(files))
        for done, (index, outcome) in enumerate(done_by, 1):
            if outcome.part is not None:
                KEPT_PARTS.keep(outcome.sha256, outcome.part)
                outcome = replace(outcome, part=None)
            outcomes[index] = outcome
            if outcome.cache_error and not self.cache_told:
                self.cache_told = True
                self.tell("cache", reason=outcome.cache_error)
            self.tell("searched", done=done, count=len(files))
        return [o for o in outcomes if o is not None]

    def _tasks(
        self, files: list[Path], target: Target | None, expected: tuple[int, int] | None, negative: bool
    ) -> Iterator[Task]:
        """A task for each picture; frames are decoded here, one after the other."""
        for path in files:
            gray = self.read(path) if is_frame(path) else None
            keep = not (KEPT_PARTS.full or negative or (target is not None and target.negative))
            yield Task(path, target, self.seconds, self.cache, gray, expected, negative, keep)

    def tell_pictures(self, outcomes: list[Outcome]) -> None:
        """Report the outcome of each picture."""
        ids = self.ids
        for done, o in enumerate(outcomes, 1):
            values = {"status": o.status, "reason": o.reason, "cached": o.cached}
            self.tell("picture", id=ids[o.path], done=done, count=len(outcomes), **values)

    def read(self, path: Path, negative: bool = False) -> Any:
        """A picture in grey (with black and white exchanged if `negative`), or None if it cannot be read."""
        try:
            gray = read_gray(path)[0]
            return ~gray if negative else gray
        except UnreadableError:
            return None


def _crashed(task: Task) -> Outcome:
    return Outcome(task.path, "unreadable", "the process that read it ended unexpectedly")
