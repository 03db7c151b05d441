"""The options that control how a target is found in pictures."""

from __future__ import annotations

import re
from typing import Any

from camcal.records import dataclass
from camcal.settings.kinds import POSITIVE, Kind, Name, Switch, Whole, refuse
from camcal.settings.option import Option, Settings, setting
from camcal.settings.sizes import BoardSize, Length, LengthKind

TARGETS = "camcal.detect.targets:TARGETS"
DEFAULT_SECONDS = 1.0  #: processor time a picture may take unless the caller says otherwise
DEFAULT_FRAMES = 40  #: frames of films that are kept: a camera gains little from more, and each costs time


class FilmTime(Kind):
    """A time in a film: seconds, or minutes (and hours) and seconds with colons."""

    metavar = "TIME"

    def convert(self, value: Any) -> float:
        """Return the time in seconds."""
        if isinstance(value, (int, float)) and not isinstance(value, bool) and value >= 0:
            return float(value)
        found = re.fullmatch(r"(?:(?:(\d{1,3}):)?(\d{1,3}):)?(\d{1,6}(?:\.\d*)?)s?", str(value).strip())
        if not found:
            raise refuse(value, "a time in a film", "Write seconds, or 1:02.5 for a minute and 2.5 seconds.")
        hours, minutes, seconds = (float(part or 0) for part in found.groups())
        return 3600 * hours + 60 * minutes + seconds


@dataclass(frozen=True)
class DetectionOptions(Settings):
    """The options of the search for a target, under the names of `detect_images`."""

    target: str | None = setting(
        Name("target", TARGETS, metavar="SPEC"),
        "Target with its sizes, such as checkerboard:9x6:25mm; `camcal list targets` names them.",
    )
    board: tuple[int, int] | None = setting(
        BoardSize(),
        "Inner corners of the board, columns x rows, such as 9x6; found from the pictures by default.",
    )
    square: Length | None = setting(
        LengthKind(), "Side of a square, such as 25mm; without it lengths are in squares."
    )
    jobs: int | None = setting(
        Whole(1, metavar="N"),
        "Processes that read pictures; as many as there are cores by default.",
        short="-j",
    )
    seconds: float = setting(
        POSITIVE,
        "Processor time allowed for the search of one picture; beyond it, the target counts as not found.",
        DEFAULT_SECONDS,
        metavar="S",
    )
    keep_frames: int = setting(
        Whole(1, metavar="N"),
        "Maximum number of frames kept of films: the sharpest, stillest and most informative.",
        DEFAULT_FRAMES,
        flag="--frames",
    )
    every: int | None = setting(
        Whole(1, metavar="K"),
        "Search every K-th frame of a film, instead of the sharpest and stillest ones.",
    )
    from_time: float | None = setting(
        FilmTime(), "Ignore a film before that time: seconds, or 1:02.5.", flag="--from"
    )
    to_time: float | None = setting(FilmTime(), "Ignore a film after that time.", flag="--to")
    cache: bool = setting(
        Switch(),
        "Cache the points of each picture and of its second pass for later runs (at most 512 MB, see docs/targets.md).",
        True,
        off="--no-cache",
    )


REFINE_CORNERS = Option(
    "refine_corners",
    Switch(),
    "Fit the corners again with the first camera; by default, kept if the hold-out improves.",
    off="--no-refine-corners",
)
