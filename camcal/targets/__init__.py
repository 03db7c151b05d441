"""The table of calibration targets: name -> class, loaded on first use."""

from __future__ import annotations

from typing import TYPE_CHECKING

from camcal import registry

if TYPE_CHECKING:
    from camcal.targets.base import Target

TARGETS = {
    "checkerboard": "camcal.targets.checkerboard:Checkerboard",
}

SUMMARIES = {
    "checkerboard": "black and white squares; checkerboard:9x6:25mm = inner corners and side of a square",
}


def make(spec: str) -> Target:
    """Make the target that a spec such as `checkerboard:9x6:25mm` names.

    Raises
    ------
    UsageError
        Where the name is unknown or an argument is missing or wrong.
    """
    name, arguments, named = registry.split_spec(spec)
    return registry.look_up(TARGETS, name, "target").parse(arguments, named)
