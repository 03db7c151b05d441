"""Run an estimator over a stream of frames: rows, changes, checkpoints, and a summary at the end."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from camcal.track import checkpoint
from camcal.track.base import Estimator, Frame, State, pack_frames, unpack_frames
from camcal.track.events import Alarm, Change, explain
from camcal.track.output import Output

#: frames after a change until it is described for good
SETTLE = 10
#: motions so slow that the camera SETTLE frames later is still the one after the change
STILL = ("fixed", "thermal")
#: changes that the summary keeps; later ones are counted only, so that memory stays bounded
KEPT = 1000


@dataclass
class Summary:
    """What a run amounts to.

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
    last : State or None
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
    last: State | None = None
    nis: float = 0.0
    nis_dof: int = 0

    def add(self, state: State) -> None:
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
class Follower:
    """A run in progress.

    Parameters
    ----------
    estimator : Estimator
    output : Output
        Where the rows go.
    on_change : callable
        Told of each change at once, before it is described for good.
    hold : int
        Frames held back to put late ones in their place.
    state : Path or None
        The checkpoint.
    every : int
        Frames between checkpoints.
    options : mapping
        What must be the same when the run is taken up again.
    """

    estimator: Estimator
    output: Output
    on_change: Callable[[Change], None] = lambda change: None
    hold: int = 0
    state: Path | None = None
    every: int = 1
    options: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.summary = Summary()
        self._heap: list[Frame] = []
        self._first: int | None = None
        self._read = 0
        self._alarm: Alarm | None = None
        self._settling = 0

    # ------------------------------------------------------------------ the run
    def run(self, frames: Iterable[Frame]) -> Summary:
        """Take all frames, then finish."""
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
        for frame in sorted(self._heap, key=_number):
            self._step(frame)
        self._heap = []
        states = list(self.estimator.finish())
        if self.estimator.offline:
            for state in states:
                self._tell(state)
        self._describe()
        self.output.flush()
        return self.summary

    def _unread(self, frames: Iterable[Frame]) -> Iterator[Frame]:
        """Skip what was read before the checkpoint where the whole stream comes again, not only its rest."""
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
        """Pass a frame on, or hold it back and pass the oldest that is held."""
        if not self.hold:
            self._step(frame)
            return
        self._heap.append(frame)
        if len(self._heap) > self.hold:
            oldest = min(self._heap, key=_number)
            self._heap = [f for f in self._heap if f is not oldest]
            self._step(oldest)

    def _step(self, frame: Frame) -> None:
        state = self.estimator.update(frame)
        self.summary.ignored = self.estimator.ignored
        if state is not None and not self.estimator.offline:
            self._tell(state)

    def _tell(self, state: State) -> None:
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
        """Describe the open change for good, by the camera of now where it has not moved on since."""
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
        """Rows first, then the state that says how many bytes of them count."""
        if self.state is None:
            return
        model = self.output.table.model
        summary = dict(vars(self.summary))
        summary["changes"] = [vars(c) for c in self.summary.changes]
        summary["last"] = checkpoint.pack_states([s for s in [self.summary.last] if s], model)
        content = {
            "options": dict(self.options),
            "estimator": self.estimator.state(),
            "output": self.output.flush(),
            "summary": summary,
            "held": pack_frames(self._heap),
            "first": self._first,
            "read": self._read,
            "alarm": None if self._alarm is None else checkpoint.pack_alarm(self._alarm),
            "settling": self._settling,
        }
        checkpoint.save(self.state, content)

    def resume(self) -> None:
        """Take up the checkpoint.

        Raises
        ------
        DataError
            Where the file is no checkpoint.
        UsageError
            Where it was made with other options, or the rows that belong to it are gone.
        """
        assert self.state is not None
        saved = checkpoint.load(self.state)
        checkpoint.require_same(self.state, saved["options"], self.options)
        self.estimator.restore(saved["estimator"])
        self.output.resume(saved["output"])
        summary = saved["summary"]
        last = checkpoint.unpack_states(summary["last"], self.output.table.model)
        self.summary = Summary(
            **{
                **summary,
                "statuses": Counter(summary["statuses"]),
                "changes": [Change(**c) for c in summary["changes"]],
                "last": last[0] if last else None,
            }
        )
        self._heap, self._first, self._read = unpack_frames(saved["held"]), saved["first"], saved["read"]
        self._alarm = None if saved["alarm"] is None else checkpoint.unpack_alarm(saved["alarm"])
        self._settling = saved["settling"]


def _number(frame: Frame) -> int:
    return frame.number
