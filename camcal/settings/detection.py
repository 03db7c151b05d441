"""How a target is found in pictures."""

from __future__ import annotations

from dataclasses import dataclass

from camcal.settings.kinds import POSITIVE, Name, Switch, Whole
from camcal.settings.option import Option, Settings, setting
from camcal.settings.sizes import BoardSize, Length, LengthKind

TARGETS = "camcal.detect.targets:TARGETS"
DEFAULT_SECONDS = 1.0  #: processor time a picture may take unless the caller says otherwise


@dataclass(frozen=True)
class DetectionOptions(Settings):
    """The options of the search for a target, under the names of `detect_images`."""

    target: str | None = setting(
        Name("target", TARGETS, metavar="SPEC"),
        "Target with its sizes, such as checkerboard:9x6:25mm; `camcal list targets` names them.",
    )
    board: tuple[int, int] | None = setting(
        BoardSize(),
        "Inner corners of the board, columns x rows, such as 9x6; found from the pictures where left out.",
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
        "Processor time to search one picture; past it, the picture counts as not found.",
        DEFAULT_SECONDS,
        metavar="S",
    )
    cache: bool = setting(Switch(), "Keep and reuse what was found in a picture.", True, off="--no-cache")


REFINE_CORNERS = Option(
    "refine_corners",
    Switch(),
    "Fit the corners again with the first camera; by default, kept if views held out fit better.",
    off="--no-refine-corners",
)
