"""The options of `camcal hand-eye`."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations

from camcal.settings.calibration import CalibrationOptions
from camcal.settings.detection import DetectionOptions
from camcal.settings.kinds import POSITIVE, Switch, Words
from camcal.settings.option import Option
from camcal.settings.run import FILE, IMAGE_SIZE, REPORT

_OF = CalibrationOptions.options()

#: names of `camcal.data.rotation_forms`, makers of robots first
ROTATIONS = (
    *("abb", "fanuc", "kawasaki", "kuka", "staubli", "ur", "yaskawa"),
    *(
        "vector",
        "vector-deg",
        "quaternion-wxyz",
        "quaternion-xyzw",
        "zyx-deg",
        "zyx-rad",
        "xyz-deg",
        "xyz-rad",
    ),
    *("fixed-xyz-deg", "fixed-xyz-rad", "zyz-deg", "zyz-rad"),
    *(f"quaternion-{order}" for order in map("".join, permutations("wxyz")) if order not in ("wxyz", "xyzw")),
)

HAND_EYE = (
    Option(
        "poses",
        FILE,
        "The robot's poses base_from_hand: view (or time), x,y,z, and rx,ry,rz or qx,qy,qz,qw or a,b,c or w,p,r.",
        required=True,
    ),
    Option(
        "setup",
        Words(("in-hand", "to-hand")),
        "The camera moves with the hand, or is fixed and sees a board in the hand. [default: recognised]",
    ),
    Option(
        "rotation",
        Words(ROTATIONS),
        "The robot's rotation convention: kuka, abb, fanuc, ur, ...; vector, zyx-deg, quaternion-wxyz, ... [default: "
        "from the names of the columns, and recognised]",
        metavar="FORM",
    ),
    Option("inverse", Switch(), "The poses are hand_from_base.", False),
    Option(
        "poses_unit",
        Words(("um", "mm", "cm", "m", "in")),
        "Unit of the poses' lengths. [default: the pictures']",
    ),
    Option("times", FILE, "Times of the views (view,time), if the poses have times."),
    Option("max_offset", POSITIVE, "Largest clock offset to search, s.", 1.0, metavar="S"),
    Option(
        "camera", FILE, "Of pictures: a known camera, which is held. [default: calibrated from the pictures]"
    ),
    replace(_OF["model"], help="Of pictures: camera model, as for `camcal checkerboard`."),
    replace(
        _OF["robust"],
        kind=Words(("auto", "none")),
        help="auto rejects poses (and points of pictures) that do not agree with the others.",
        metavar="auto|none",
    ),
    *DetectionOptions.command_line(),
    IMAGE_SIZE,
    replace(_OF["crosscheck"], kind=Switch(), help="Compare every stage with OpenCV."),
    _OF["fail_on"],
    _OF["seed"],
    *REPORT,
)
