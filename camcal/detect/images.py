"""Pictures of a calibration target -> correspondences."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from camcal.data.observations import Correspondences, SkippedView, View
from camcal.detect import cache as cache_files
from camcal.detect import targets
from camcal.detect.examine import Outcome, Task, examine
from camcal.detect.listing import list_pictures, view_ids
from camcal.detect.targets.base import DEFAULT_SECONDS, Target
from camcal.detect.targets.checkerboard import Checkerboard
from camcal.detect.workers import map_unordered
from camcal.errors import DataError, UsageError
from camcal.settings.sizes import parse_grid, parse_length

#: called with (what happens, details) as the work goes on
OnEvent = Callable[[str, Mapping[str, Any]], None]

MOST_REASONS = 3  #: that are told where no picture shows the target
LEAST_VOTES = 0.35  #: share of the pictures with a grid that must agree on the size of the board


def detect_images(
    paths: Iterable[str | os.PathLike],
    target: str | Target | None = None,
    board: str | tuple[int, int] | None = None,
    square: str | tuple[float, str] | None = None,
    jobs: int | None = None,
    seconds: float = DEFAULT_SECONDS,
    on_event: OnEvent | None = None,
    cache: bool = True,
) -> Correspondences:
    """Find a target in pictures.

    Parameters
    ----------
    paths : folders, files or patterns
    target : str or Target, optional
        A spec such as `charuco:9x7:40mm:20mm:4X4_100`. Without it a checkerboard is looked for, and without
        `board` its size is found from the pictures: the size of most grids whose end is seen on all sides,
        the longer side being the columns.
    board : str or (columns, rows), optional
        Inner corners of a checkerboard.
    square : str or (value, unit), optional
        Side of its squares.
    jobs : int, optional
        Processes; one per processor where there is enough to do.
    seconds : float
        Time that one picture may take.
    on_event : callable, optional
        Called with `("pictures", {count})`, `("picture", {id, status, reason, done, count, cached})`,
        `("board", {columns, rows, votes, of})` and `("cache", {reason})` where the cache cannot be written.
    cache : bool
        Whether results are kept and reused.

    Returns
    -------
    Correspondences
        A view for each picture with the target, the rest in `skipped`. All views are of the size that most
        of them have; the others are `rejected`.

    Raises
    ------
    DataError
        Where there are no pictures, or none shows the target.
    UsageError
        Where the target is unknown or contradicts `board` or `square`.
    """
    wanted = _wanted(target, board, square)
    files = list_pictures(paths)
    ids = dict(zip(files, view_ids(files), strict=True))
    run = _Run(files, ids, seconds, jobs, cache_files.default_folder() if cache else None, on_event)
    run.tell("pictures", count=len(files))
    outcomes = run.examine_all(files, wanted)
    detected = wanted is None
    if wanted is None:
        wanted = _majority_board(outcomes, square, run)
        outcomes = _with_known_board(outcomes, wanted, run)
    return _correspondences(outcomes, wanted, detected, ids)


class _Run:
    """One call of `detect_images`: what all its pictures share."""

    def __init__(
        self,
        files: list[Path],
        ids: dict[Path, str],
        seconds: float,
        jobs: int | None,
        cache: Path | None,
        on_event: OnEvent | None,
    ):
        self.files, self.ids, self.seconds, self.jobs, self.cache = files, ids, seconds, jobs, cache
        self.on_event = on_event
        self.cache_told = False

    def tell(self, name: str, **details: Any) -> None:
        if self.on_event is not None:
            self.on_event(name, details)

    def examine_all(self, files: list[Path], target: Target | None) -> list[Outcome]:
        """Outcomes in the order of the files."""
        tasks = [Task(path, target, self.seconds, self.cache) for path in files]
        outcomes: list[Outcome | None] = [None] * len(tasks)
        for done, (index, outcome) in enumerate(map_unordered(examine, tasks, self.jobs, _crashed), 1):
            outcomes[index] = outcome
            if outcome.cache_error and not self.cache_told:
                self.cache_told = True
                self.tell("cache", reason=outcome.cache_error)
            self.tell(
                "picture",
                id=self.ids[outcome.path],
                status=outcome.status,
                reason=outcome.reason,
                done=done,
                count=len(tasks),
                cached=outcome.cached,
            )
        return [o for o in outcomes if o is not None]


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


def _majority_board(
    outcomes: list[Outcome], square: str | tuple[float, str] | None, run: _Run
) -> Checkerboard:
    """The board that most pictures show whole."""
    seen = [o.board for o in outcomes if o.status == "found" and o.board]
    votes = Counter(o.board for o in outcomes if o.status == "found" and o.whole and o.board)
    if not votes or votes.most_common(1)[0][1] < LEAST_VOTES * len(seen):
        if seen:
            columns, rows = Counter(seen).most_common(1)[0][0]
            raise DataError(
                f"{len(seen)} of {len(outcomes)} pictures show a checkerboard, but too few show its end, "
                "or they do not agree on its size.",
                f"Say its size in inner corners, as in --board {columns}x{rows}.",
            )
        raise _nothing_found("checkerboard", outcomes)
    (columns, rows), count = votes.most_common(1)[0]
    run.tell("board", columns=columns, rows=rows, votes=count, of=len(seen))
    return Checkerboard(columns, rows, *_length(square))


def _with_known_board(outcomes: list[Outcome], board: Checkerboard, run: _Run) -> list[Outcome]:
    """Look again, with the size now known, where something else was found."""
    size = (board.columns, board.rows)
    again = [o.path for o in outcomes if o.status == "found" and not (o.board == size and o.whole)]
    new = {o.path: o for o in run.examine_all(again, board)}
    return [new.get(o.path, o) for o in outcomes]


def _correspondences(
    outcomes: list[Outcome], target: Target, detected: bool, ids: dict[Path, str]
) -> Correspondences:
    found = [o for o in outcomes if o.detection is not None]
    if not found:
        raise _nothing_found(f"{target.columns}x{target.rows} {target.kind}", outcomes)
    size = Counter(o.size for o in found).most_common(1)[0][0]
    views, skipped = [], []
    for o in outcomes:
        if o.detection is None:
            skipped.append(SkippedView(ids[o.path], o.status, o.reason))
        elif o.size != size:
            skipped.append(SkippedView(ids[o.path], "rejected", _other_size(o.size, size)))
        else:
            d = o.detection
            views.append(View(ids[o.path], target.points[d.point_ids], d.uv, d.sigma, d.point_ids))
    files = tuple({"path": str(o.path), "sha256": o.sha256} for o in outcomes)
    quality = {ids[o.path]: o.quality for o in outcomes if o.quality}
    described = {**target.describe(), "detected": detected}
    return Correspondences(tuple(views), size, described, tuple(skipped), files, quality)


def _other_size(found: tuple[int, int] | None, needed: tuple[int, int] | None) -> str:
    words = ["x".join(map(str, s or ())) for s in (found, needed)]
    return f"the picture has {words[0]} pixels, most of the others {words[1]}"


def _nothing_found(what: str, outcomes: list[Outcome]) -> DataError:
    """The error for a set of pictures without the target, with the commonest reasons as its hint."""
    other = Counter(o.board for o in outcomes if o.code == "other-size" and o.board)
    message = f"no {what} was found in {len(outcomes)} picture{'s' * (len(outcomes) != 1)}."
    if other:
        (columns, rows), count = other.most_common(1)[0]
        return DataError(message, f"{count} show a {columns}x{rows} board. Try: --board {columns}x{rows}")
    # reasons of one code differ in figures; those of files that cannot be read have no code
    example = {o.code or o.reason: o.reason for o in reversed(outcomes)}
    kinds = Counter(o.code or o.reason for o in outcomes).most_common(MOST_REASONS)
    said = "; ".join(f"{number} of {len(outcomes)}: {example[kind]}" for kind, number in kinds)
    return DataError(message, said + ".")
