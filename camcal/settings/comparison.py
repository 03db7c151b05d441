"""The options of the commands that compare: cameras, and optimizers."""

from __future__ import annotations

from dataclasses import replace

from camcal.settings.calibration import MAX_PX, ONE_MODEL, CalibrationOptions
from camcal.settings.kinds import POSITIVE, Assignments, Several, Text, Whole, Words
from camcal.settings.option import Option
from camcal.settings.run import CI, IMAGE_SIZE, OUT, REPORT, TRACE
from camcal.settings.sizes import DISTANCE

_OF = CalibrationOptions.options()
COMPARE = (
    Option(
        "against",
        Words(("cv2",)),
        "Instead of B: a new calibration of A's points by OpenCV.",
    ),
    Option(
        "distance",
        Several(DISTANCE),
        "Distance of the points that are compared, in the unit of the data; infinity by default.",
        repeated=True,
    ),
    IMAGE_SIZE,
    replace(MAX_PX, help="A gate: the largest difference of projection where both cameras have data."),
    replace(MAX_PX, name="max_rms_px", help="A gate: the root mean square of the differences there."),
    replace(MAX_PX, name="max_p95_px", help="A gate: their 95th percentile there."),
    Option(
        "max_sigma", POSITIVE, "A gate: the largest difference there in standard deviations.", metavar="N"
    ),
    Option(
        "tolerance",
        Assignments("NAME=VALUE,...", "fx=0.5,cx=0.5", values=True),
        "A gate: the largest change of a parameter, in its own unit.",
        {},
        repeated=True,
    ),
    *CI,
    *REPORT,
)

COMPARE_OPTIMIZERS = (
    IMAGE_SIZE,
    ONE_MODEL,
    _OF["skew"],
    _OF["fix"],
    Option(
        "optimizers",
        Text(),
        "Optimizers to run, with variants such as lbfgs:scaled; all that `camcal list optimizers` names by default.",
        metavar="NAME,...",
    ),
    Option(
        "perturbed", Whole(0), "Number of randomly perturbed starts, in addition to the closed form's.", 3
    ),
    Option(
        "perturbation",
        POSITIVE,
        "Size of the displacement: focal length, depth and principal point relative, rotations in rad.",
        0.02,
    ),
    Option("max_seconds", POSITIVE, "Longest time of one run, s.", 20.0),
    Option(
        "total_seconds",
        POSITIVE,
        "Longest time of all runs together, s; what is left is divided among the remaining runs.",
        60.0,
    ),
    Option(
        "rotation",
        Words(("left", "vector", "quaternion", "euler")),
        "Coordinates of rotations; left = perturbations on the left, as everywhere else.",
        "left",
    ),
    replace(_OF["normalise"], help="Centre points and scale columns."),
    replace(TRACE, help="Write every step of every run to FILE (CSV)."),
    Option("plot", OUT, "Draw the convergence to FILE (needs matplotlib)."),
    _OF["seed"],
    *REPORT,
)
