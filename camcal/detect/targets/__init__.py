"""The table of calibration targets: name -> class, loaded on first use."""

from __future__ import annotations

from typing import TYPE_CHECKING

from camcal import registry

if TYPE_CHECKING:
    from camcal.detect.targets.base import Target

TARGETS = {
    "checkerboard": "camcal.detect.targets.checkerboard:Checkerboard",
    "charuco": "camcal.detect.targets.charuco:Charuco",
    "aprilgrid": "camcal.detect.targets.aprilgrid:AprilGrid",
    "circles": "camcal.detect.targets.circles:Circles",
    "asymmetric-circles": "camcal.detect.targets.circles:AsymmetricCircles",
    "squares": "camcal.detect.targets.squares:SquareGrid",
}

SUMMARIES = {
    "checkerboard": "black and white squares; checkerboard:9x6:25mm = inner corners and side of a square",
    "charuco": "checkerboard with markers; charuco:9x7:40mm:20mm:4X4_100 = squares, side, marker, dictionary",
    "aprilgrid": "Kalibr's tags; aprilgrid:6x6:22mm:0.3 = tags, side, spacing; or aprilgrid:FILE.yaml",
    "circles": "discs in rows; circles:10x8:2.5mm = columns, rows, their distance (and :diameter)",
    "squares": "separate squares (Zhang, BoofCV); squares:8x8:12.7mm:0.78 = side, gap as a share of it",
    "asymmetric-circles": "staggered discs as OpenCV's; asymmetric-circles:4x11:20mm, the distance of rows",
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
