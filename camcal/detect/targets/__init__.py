"""The table of calibration targets: name -> class, loaded on first use."""

from __future__ import annotations

from typing import TYPE_CHECKING

from camcal import registry
from camcal.errors import UsageError

if TYPE_CHECKING:
    import numpy as np

    from camcal.detect.targets.base import Detection, Miss, Target

TARGETS = {
    "checkerboard": "camcal.detect.targets.checkerboard:Checkerboard",
    "charuco": "camcal.detect.targets.charuco:Charuco",
    "aprilgrid": "camcal.detect.targets.aprilgrid:AprilGrid",
    "aruco-grid": "camcal.detect.targets.tag_grid:TagGrid",
    "circles": "camcal.detect.targets.circles:Circles",
    "asymmetric-circles": "camcal.detect.targets.circles:AsymmetricCircles",
    "squares": "camcal.detect.targets.squares:SquareGrid",
}

SUMMARIES = {
    "checkerboard": "black and white squares; checkerboard:9x6:25mm = inner corners and side of a square",
    "charuco": "checkerboard with markers; charuco:9x7:40mm:20mm:4X4_100 = squares, side, marker, dictionary",
    "aprilgrid": "Kalibr's tags; aprilgrid:6x6:22mm:0.3 = tags, side, spacing; or aprilgrid:FILE.yaml",
    "aruco-grid": "markers in rows (cv2's GridBoard); aruco-grid:5x7:40mm:0.25:4X4_50 = side, gap as a fraction of it",
    "circles": "discs in rows; circles:10x8:2.5mm = columns, rows, their distance (and :diameter)",
    "squares": "separate squares (Zhang, BoofCV); squares:8x8:12.7mm:0.78 = side, gap as a fraction of it",
    "asymmetric-circles": "staggered discs as OpenCV's; asymmetric-circles:4x11:20mm, the distance of rows",
}


BOTH = "+"  #: between the specs of several boards


def make_all(spec: str) -> list[Target]:
    """The targets of one spec, or of several joined by a plus.

    Raises
    ------
    UsageError
        As `make`; if several targets are not boards with markers of different ids.
    """
    made = [make(part) for part in spec.split(BOTH)]
    markers: set[tuple[str, int]] = set()
    for target in made if len(made) > 1 else []:
        ids = getattr(target, "tag_ids", None)
        own = set() if ids is None else {(str(getattr(target, "dictionary", "")), int(i)) for i in ids}
        if not own or own & markers:
            raise UsageError(
                f"'{spec}': several targets in one picture must be boards with markers of different ids.",
                "Print them with different dictionaries, or with start=N.",
            )
        markers |= own
    return made


def make(spec: str) -> Target:
    """Make the target that a spec such as `checkerboard:9x6:25mm` names.

    Raises
    ------
    UsageError
        If the name is unknown or an argument is missing or wrong.
    """
    name, arguments, named = registry.split_spec(spec)
    plain = [a for a in arguments if a.lower() != "negative"]
    made: Target = registry.look_up(TARGETS, name, "target").parse(plain, named)
    return made.as_negative() if len(plain) < len(arguments) else made


def find(target: Target, gray: np.ndarray, seconds: float) -> Detection | Miss:
    """Search for a target in a grey picture (height, width), with black and white exchanged for a negative target.

    If nothing like it is found, the search is repeated with locally equalised contrast (`local_contrast.py`).
    """
    from camcal.detect.local_contrast import with_second_look
    from camcal.detect.targets.base import NOTHING

    shown = ~gray if target.negative else gray
    return with_second_look(
        shown, lambda: target.find(shown, seconds), lambda found: getattr(found, "reason", "") in NOTHING
    )
