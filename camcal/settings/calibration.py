"""The options of a calibration, for any kind of input."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from camcal.records import dataclass
from camcal.settings.kinds import POSITIVE, Assignments, CameraSource, Name, Switch, SwitchOr, Whole, Words
from camcal.settings.option import Settings, setting

#: a lens model, as of commands that do not choose one themselves
MODEL = Name("model", "camcal.model.lenses:LENSES", metavar="NAME[:ARGS]")


@dataclass(frozen=True)
class CalibrationOptions(Settings):
    """The options of a calibration, under the names that the command line and `camcal.calibrate` use.

    `CalibrationOptions.resolve(**keywords)` converts and checks the keywords of a call and refuses unknown ones.
    """

    model: str = setting(
        Name("model", "camcal.model.lenses:LENSES", also=("auto", "select"), metavar="NAME[:ARGS]"),
        "Camera model; `camcal list models` names them. auto: opencv5 if it is suitable, otherwise a "
        "wide-lens or a smaller model; select: the best of the ranking that `camcal select` shows.",
        "auto",
        short="-m",
    )
    skew: bool = setting(Switch(), "Also estimate the skew of the pixel axes.", False)
    fix: Mapping[str, float | None] = setting(
        Assignments(),
        "Fix parameters at VALUE or at their initial value; `aspect` means fy = fx.",
        {},
        repeated=True,
    )
    start: str | None = setting(
        Name("closed form", "camcal.start:CLOSED_FORMS"),
        "Closed form to start from; `camcal list closed-forms` names them. By default the points determine it.",
    )
    start_camera: Any = setting(  # a Camera in Python, or a file
        CameraSource(), "Start with this camera instead of a closed form; a camera file of any format."
    )
    optimizer: str = setting(
        Name("optimizer", "camcal.solve.optimizers:OPTIMIZERS"),
        "The optimizer of the reprojection error; `camcal list optimizers` names them.",
        "lm",
    )
    robust: str = setting(
        Name("robust method", "camcal.solve:ROBUST_SUMMARIES", metavar="METHOD"),
        "Treatment of outliers: none, auto (which tests for them first), or the name of a loss.",
        "auto",
        in_python="none",
    )
    board_shape: str = setting(
        Name("board shape", "camcal.solve:BOARD_SHAPE_SUMMARIES", files=True, metavar="SHAPE|REPORT"),
        "The board's shape: flat as designed; estimated too: bowl, print, free (each point), or auto, which "
        "keeps a shape only if views held out confirm it; or the report that found it.",
        "flat",
    )
    crosscheck: bool | str = setting(
        SwitchOr("full"),
        "Compare with OpenCV, which starts at the result and must stay there. `--crosscheck full`: "
        "compare every stage, with OpenCV's own start, which takes as long as its calibrations.",
        True,
        in_python=False,  # a program that calls camcal should not pay for it unasked
        off="--no-crosscheck",
    )
    holdout: int | None = setting(
        Whole(0, metavar="K"),
        "Calibrate K times without every K-th view and test the camera on it. By default 4 if that is quick; "
        "0 disables it.",
    )
    max_rms: float | None = setting(
        POSITIVE, "A gate: the verdict is fail, exit code 1, if rms_point is larger.", metavar="PX"
    )
    fail_on: str = setting(
        Words(("never", "doubtful", "wrong")),
        "The lowest severity of a warning at which the verdict is fail, exit code 1.",
        "wrong",
    )
    seed: int = setting(Whole(0), "Seed of random numbers.", 0)
    normalise: bool = setting(
        Switch(),
        "Centre and scale coordinates and columns at every stage; off is for demonstration.",
        True,
        off="--no-normalise",
        show_default=False,
    )
    checks: bool = setting(
        Switch(),
        "Run the checks, the hold-out and the estimate of the conditioning.",
        True,
        on_command_line=False,
    )


#: of commands that take one model as it is
ONE_MODEL = replace(
    CalibrationOptions.options()["model"],
    kind=MODEL,
    default="opencv5",
    help="Camera model; `camcal list models` names them.",
)
#: a gate in px, of commands that compare
MAX_PX = replace(CalibrationOptions.options()["max_rms"], name="max_px")
