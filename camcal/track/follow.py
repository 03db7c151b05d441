"""Run an estimator over a stream of frames: rows, changes, checkpoints, and a summary at the end."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import field, replace
from pathlib import Path
from typing import Any, ClassVar

from camcal.records import dataclass
from camcal.track import checkpoint
from camcal.track.estimator import Estimator, TrackState
from camcal.track.events import Alarm, Change, explain
from camcal.track.frames import Frame
from camcal.track.keep import Kept, stored
from camcal.track.output import Output

#: frames after a change until its final description: the spread of the camera after it has then fallen to
#: about a third of that of one frame
SETTLE = 10
#: motions so slow that the camera SETTLE frames later is still the one after the change
STILL = ("fixed", "thermal")
#: changes that the summary keeps; later ones are counted only, so that memory stays bounded
KEPT = 1000


@stored
@dataclass
class Summary:
    """The summary of a run.

    Attributes
    ----------
    frames : int
        Frames that gave a row.
    statuses : Counter of status -> frames
    points, used : int
    ignored : int
        Frames that came late or repeated a number.
    changes : list of Change
        The first `KEPT`.
    change_count : int
    last : TrackState or None
        The last one with an estimate.
    nis, nis_dof : float
        Sums over the tested frames; their ratio is 1 for a filter that knows its own uncertainty.
    """

    frames: int = 0
    statuses: Counter[str] = field(default_factory=Counter)
    points: int = 0
    used: int = 0
    ignored: int = 0
    changes: list[Change] = field(default_factory=list)
    change_count: int = 0
    last: TrackState | None = None
    nis: float = 0.0
    nis_dof: int = 0

    def __post_init__(self) -> None:
        self.statuses = Counter(self.statuses)  # a checkpoint holds a plain mapping

    def add(self, state: TrackState) -> None:
        """Count a frame."""
        self.frames += 1
        self.statuses[state.status] += 1
        self.points += state.points
        self.used += state.used
        if state.estimate is not None:
            self.last = state
        if state.status == "updated":
            self.nis += state.nis
            self.nis_dof += state.nis_dof


@dataclass
class Follower(Kept):
    """A run in progress.

    Parameters
    ----------
    estimator : Estimator
    output : Output
        Where the rows go.
    on_change : callable
        Called with each change at once, before its final description.
    hold : int
        Frames held back to put late ones in their place.
    state_file : Path or None
        Where the state is kept.
    every : int
        Frames between checkpoints.
    options : mapping
        What must be the same when the run is taken up again.
    """

    kept: ClassVar[tuple[str, ...]] = (
        "estimator",
        "summary",
        "_held",
        "_first",
        "_read",
        "_alarm",
        "_settling",
    )

    estimator: Estimator
    output: Output
    on_change: Callable[[Change], None] = lambda change: None
    hold: int = 0
    state_file: Path | None = None
    every: int = 1
    options: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.summary = Summary()
        self._held: list[Frame] = []
        self._first: int | None = None
        self._read = 0
        self._alarm: Alarm | None = None
        self._settling = 0
        self._resumed = False

    # ------------------------------------------------------------------ the run
    def run(self, frames: Iterable[Frame]) -> Summary:
        """Process all frames, then finish.

        Raises
        ------
        DataError
            If the state that the run went on from does not fit the frames: it is damaged.
        """
        if self._resumed and self.state_file is not None:
            with checkpoint.damage(self.state_file):
                return self._run(frames)
        return self._run(frames)

    def _run(self, frames: Iterable[Frame]) -> Summary:
        since = 0
        for frame in self._unread(frames):
            self._take(frame)
            since += 1
            if since >= self.every:
                since = 0
                self._checkpoint()
        if since:
            # before the end is dealt with: a later run may find that the stream went on
            self._checkpoint()
        for frame in sorted(self._held, key=_number):
            self._step(frame)
        self._held = []
        states = list(self.estimator.finish())
        if self.estimator.offline:
            for state in states:
                self._add(state)
        self._describe()
        self.output.flush()
        return self.summary

    def _unread(self, frames: Iterable[Frame]) -> Iterator[Frame]:
        """Skip frames read before the checkpoint if the whole stream is supplied again rather than its rest."""
        stream = iter(frames)
        head = next(stream, None)
        if head is None:
            return
        if self._first is None:
            self._first = head.number
        elif self._read and head.number == self._first:
            stream = itertools.islice(stream, self._read - 1, None)
            head = next(stream, None)
        for frame in itertools.chain([head] if head is not None else [], stream):
            self._read += 1
            yield frame

    def _take(self, frame: Frame) -> None:
        """Pass a frame on, or hold it back and pass on the oldest held frame."""
        if not self.hold:
            self._step(frame)
            return
        self._held.append(frame)
        if len(self._held) > self.hold:
            oldest = min(self._held, key=_number)
            self._held = [f for f in self._held if f is not oldest]
            self._step(oldest)

    def _step(self, frame: Frame) -> None:
        state = self.estimator.update(frame)
        self.summary.ignored = self.estimator.ignored
        if state is not None and not self.estimator.offline:
            self._add(state)

    def _add(self, state: TrackState) -> None:
        self.output.add(state)
        self.summary.add(state)
        if state.alarm is not None:
            self._describe()
            self._alarm, self._settling = state.alarm, SETTLE
            self.on_change(explain(state.alarm))
        elif self._alarm is not None and state.status == "updated":
            self._settling -= 1
            if self._settling == 0:
                self._describe()

    # ------------------------------------------------------------------ changes
    def _describe(self) -> None:
        """Write the final description of the last change, by the current camera if it has not moved since."""
        if self._alarm is None:
            return
        alarm, last, options = self._alarm, self.summary.last, self.estimator.options
        still = options.motion in STILL and not options.drift and not options.velocity
        if still and last is not None and last.factor is not None:
            after = self.output.table.model.describe([last.estimate], [last.factor])
            alarm = replace(alarm, after=after)
        self.summary.change_count += 1
        if len(self.summary.changes) < KEPT:
            self.summary.changes.append(explain(alarm))
        self._alarm = None

    # ------------------------------------------------------------------ checkpoints
    def _checkpoint(self) -> None:
        """Write the rows, then the state, which records how many bytes of them belong to it."""
        if self.state_file is not None:
            rows = self.output.flush()
            checkpoint.save(self.state_file, {"options": self.options, "rows": rows, "run": self.state()})

    def resume(self) -> None:
        """Continue from the checkpoint if there is one; otherwise write the first one.

        The first one is written before the table is begun, so that a run that is killed at any moment can be
        started again.

        Raises
        ------
        DataError
            If the file is no checkpoint.
        UsageError
            If it was made with other options, or the rows that belong to it are gone.
        """
        if self.state_file is None:
            return
        if not self.state_file.exists():
            content = {"options": self.options, "rows": 0, "run": self.state()}
            checkpoint.save(self.state_file, content)
            return
        saved = checkpoint.load(self.state_file)
        with checkpoint.damage(self.state_file):
            checkpoint.require_same(self.state_file, saved["options"], self.options)
            self.restore(saved["run"])
            self.output.resume(int(saved["rows"]))
        self._resumed = True


def _number(frame: Frame) -> int:
    return frame.number
