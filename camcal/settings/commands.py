"""The options of every command, in the order of its help."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

from camcal.settings.batch import BATCH, COMPACT, FLEET_PRIOR, WATCH
from camcal.settings.calibration import MAX_PX, MODEL, ONE_MODEL, CalibrationOptions
from camcal.settings.comparison import COMPARE, COMPARE_OPTIMIZERS
from camcal.settings.detection import REFINE_CORNERS, DetectionOptions
from camcal.settings.hand_eye import HAND_EYE
from camcal.settings.kinds import (
    POSITIVE,
    Assignments,
    Name,
    Places,
    Real,
    Several,
    Text,
    Whole,
    Words,
)
from camcal.settings.option import Option
from camcal.settings.rig import IMAGE_SIZES, NOT_OF_RIGS, RigOptions
from camcal.settings.run import (
    CI,
    CONFIG,
    FILE,
    FORCE,
    FORMAT,
    IMAGE_SIZE,
    MODELS,
    OUT,
    OUTPUT,
    PLOTS,
    POINTS2D,
    POINTS3D,
    REPORT,
    RESULT,
    SWITCH,
    TRACE,
)
from camcal.settings.simulation import SIMULATIONS
from camcal.settings.sizes import DISTANCE, Pixel
from camcal.settings.tracking import METHOD, RUN, TrackOptions
from camcal.settings.undistortion import RECTIFY, UNDISTORT

CALIBRATION = (*CalibrationOptions.command_line(), TRACE)
BOARD = DetectionOptions.command_line()

_OF = CalibrationOptions.options()
#: of commands that calibrate nothing
_CROSSCHECK = replace(_OF["crosscheck"], kind=SWITCH, help="Compare every stage with OpenCV.")

_NEXT = (
    Option(
        "count",
        Whole(1, 50, metavar="N"),
        "Number of pictures to suggest, each assuming that the previous ones were taken.",
        1,
    ),
    Option(
        "distance",
        DISTANCE,
        "Distance at which the uncertainty is computed, in the unit of the data.",
        float("inf"),
    ),
    Option(
        "target_px",
        POSITIVE,
        "Show how many more pictures reduce the worst uncertainty to PX.",
        metavar="PX",
    ),
    replace(OUTPUT, help="Draw where to hold the target (.svg, .png, .pdf)."),
    _OF["seed"],
    FORCE,
    FORMAT,
    CONFIG,
)


def _of_pictures(options: Iterable[Option]) -> tuple[Option, ...]:
    """Return the options for pictures of a printed target, whose shape is estimated where the data determine it."""
    return tuple(replace(o, default="auto") if o.name == "board_shape" else o for o in options)


def _either(
    options: Iterable[Option], said: str = "By default auto for pictures, flat for tables."
) -> tuple[Option, ...]:
    """Return the options for data that may or may not show a printed target, which is known only at run time."""
    return tuple(
        replace(o, help=f"{o.help} {said}", default=None) if o.name == "board_shape" else o for o in options
    )


_IMAGES = (
    *BOARD,
    REFINE_CORNERS,
    Option("save_corners", OUT, "Write the final corners too, as the table that `camcal detect` makes."),
    *_of_pictures(CALIBRATION),
    *RESULT,
)

#: command, or group and sub-command -> its options
OPTIONS: dict[str, tuple[Option, ...]] = {
    "estimate": (
        POINTS3D,
        POINTS2D,
        Option(
            "distortion",
            FILE,
            "A camera whose distortion is held, such as `camcal lines` writes; sets --model.",
        ),
        replace(
            DetectionOptions.options()["board"],
            help="Inner corners of the board of a .vnl file, columns x rows.",
        ),
        replace(DetectionOptions.options()["square"], help="Side of a square of that board, such as 25mm."),
        IMAGE_SIZE,
        *_either(CALIBRATION, "By default auto if the table marks its points as printed, else flat."),
        *RESULT,
    ),
    "rig": (
        *BOARD,
        REFINE_CORNERS,
        replace(IMAGE_SIZE, kind=IMAGE_SIZES, default={}, repeated=True),
        *_either(RigOptions.command_line(*NOT_OF_RIGS)),
        *RESULT,
    ),
    "checkerboard": _IMAGES,
    "images": _IMAGES,
    "batch": (
        *BATCH,
        COMPACT,
        FLEET_PRIOR,
        *CI,
        *BOARD,
        IMAGE_SIZE,
        *_either(CalibrationOptions.command_line()),
        FORCE,
        CONFIG,
    ),
    "watch": (
        *WATCH,
        *BOARD,
        REFINE_CORNERS,
        # the board as designed: the target of --target-px then means the same from the first picture to the last
        *_either(CalibrationOptions.command_line(), "By default auto with --once, else flat."),
        FORCE,
        CONFIG,
    ),
    "detect": (
        replace(
            OUTPUT,
            help="The table (CSV: file, id, X, Y, Z, u, v, sigma, printed; .npz; .vnl).",
            required=True,
        ),
        *BOARD,
        FORCE,
        CONFIG,
    ),
    "evaluate": (
        Option("lines", SWITCH, "The data are straight lines: pictures of them, or tables line,u,v.", False),
        Option(
            "natural",
            SWITCH,
            "The data are pictures of arbitrary scenes, NAME=PICTURES of two cameras of a rig taken at "
            "the same instants.",
            False,
        ),
        *BOARD,
        IMAGE_SIZE,
        _OF["robust"],
        _OF["max_rms"],
        _OF["fail_on"],
        _OF["seed"],
        *REPORT,
    ),
    "uncertainty": (
        Option(
            "at",
            Several(Pixel()),
            "Pixel at which the uncertainty is computed; may be given several times.",
            repeated=True,
        ),
        Option(
            "distance",
            Several(DISTANCE),
            "Distance from the camera, in the unit of the data; by default that of the boards, and infinity.",
            repeated=True,
        ),
        replace(MAX_PX, help="A gate: exit code 1 if a sigma is larger."),
        FORMAT,
        CONFIG,
    ),
    "lines": (
        ONE_MODEL,
        replace(
            _OF["fix"],
            help="Fix parameters; fx=VALUE sets the focal length, which lines do not determine.",
        ),
        IMAGE_SIZE,
        replace(
            _OF["robust"],
            kind=Words(("auto", "none", "lines")),
            help="lines rejects lines that are not straight compared with the others; auto does so in pictures only. "
            "In both cases, points far from their line lose weight; none keeps all points and weights.",
            metavar="auto|none|lines",
        ),
        _CROSSCHECK,
        *REPORT,
    ),
    "selfcalib": (
        replace(ONE_MODEL, default="opencv4"),
        replace(
            _OF["fix"], help="Fix parameters at VALUE or at their initial value; fy = fx unless fy is given."
        ),
        IMAGE_SIZE,
        Option(
            "save_tracks", OUT, "Write the tracks that were found in pictures, as a table view,point,u,v."
        ),
        _CROSSCHECK,
        _OF["seed"],
        *REPORT,
    ),
    "scene": (
        replace(ONE_MODEL, default="pinhole"),
        replace(
            _OF["fix"], help="Fix parameters at VALUE or at the middle of the picture; fy = fx by default."
        ),
        IMAGE_SIZE,
        _OF["seed"],
        *REPORT,
    ),
    "pose": (
        replace(
            _OF["robust"],
            kind=Words(("auto", "none")),
            help="auto rejects points that do not agree with the rest; none uses all.",
            metavar="auto|none",
        ),
        _CROSSCHECK,
        _OF["seed"],
        *REPORT,
    ),
    "wand": (
        Option(
            "bar",
            Places(),
            "Length between two markers, or the position of each marker along the bar, in the order of "
            "their names; in the unit of the result.",
            required=True,
        ),
        Option(
            "bar_sigma",
            POSITIVE,
            "Standard deviation of the bar's length; by default the length is exact.",
            metavar="LENGTH",
        ),
        replace(
            RigOptions.options()["cameras"],
            help="Cameras that are known and held; camera files of any format.",
        ),
        replace(
            ONE_MODEL, default="pinhole", help="Camera model of the others; `camcal list models` names them."
        ),
        replace(
            _OF["fix"],
            help="Fix parameters of the others at VALUE or at their initial value; fy = fx by default.",
        ),
        replace(IMAGE_SIZE, kind=IMAGE_SIZES, default={}, repeated=True),
        _CROSSCHECK,
        _OF["seed"],
        *REPORT,
    ),
    "triangulate": (
        replace(OUTPUT, help="Write the points to FILE (CSV)."),
        _CROSSCHECK,
        FORCE,
        FORMAT,
        CONFIG,
    ),
    "hand-eye": HAND_EYE,
    "compare": COMPARE,
    "select": (
        MODELS,
        Option("folds", Whole(2), "Number of hold-out rounds.", 5),
        _OF["skew"],
        _OF["fix"],
        _OF["robust"],
        _OF["seed"],
        IMAGE_SIZE,
        *BOARD,
        *REPORT,
    ),
    "convert": (
        Option(
            "to",
            Name("format", "camcal.data.formats:FORMATS", metavar="FORMAT"),
            "Format of DST; `camcal list formats` names them; by default that of its extension.",
        ),
        Option(
            "source_format",
            Name("format", "camcal.data.formats:FORMATS", metavar="FORMAT"),
            "Format of SRC; recognised from its content by default.",
            flag="--from",
        ),
        Option("camera", Text(), "The camera of SRC to convert, if it has several.", metavar="NAME"),
        Option("to_model", MODEL, "Refit to this model; `camcal list models` names them."),
        _OF["skew"],
        replace(
            MAX_PX,
            help="The largest difference, anywhere in the image, that a refit may have.",
            default=0.5,
        ),
        IMAGE_SIZE,
        *REPORT,
    ),
    "lens-fit": (
        ONE_MODEL,
        _OF["skew"],
        Option(
            "ideal",
            Assignments("fx=F,fy=F,cx=C,cy=C", "fx=800,cx=320,cy=240", values=True),
            "The camera of the ideal points, px; without it they lie on the plane z = 1, or a camera is "
            "assumed.",
        ),
        IMAGE_SIZE,
        *REPORT,
    ),
    "undistort": UNDISTORT,
    "rectify": RECTIFY,
    "report": (
        replace(OUTPUT, help="The page (HTML); REPORT with .html by default."),
        PLOTS,
        Option(
            "plot_format",
            Several(Words(("png", "svg", "pdf"))),
            "Format of the charts; may be given several times.",
            ("png",),
            repeated=True,
        ),
        FORCE,
        CONFIG,
    ),
    "compare-optimizers": COMPARE_OPTIMIZERS,
    "doctor": (ONE_MODEL, IMAGE_SIZE, *BOARD, FORMAT, CONFIG),
    "next": _NEXT,
    "track": (METHOD, *TrackOptions.command_line(), *RUN, *DetectionOptions.command_line("keep_frames")),
    "board": (
        replace(OUTPUT, help="Output file; .svg, .pdf or .png.", required=True),
        Option(
            "page",
            Text(),
            "A4, A3, letter, ..., WIDTHxHEIGHT in mm, own (as large as the target needs), or the first of A4, "
            "letter, A3, ... on which it fits.",
            "auto",
            metavar="NAME",
        ),
        Option("dpi", Real(10, 2400), "Pixels per inch of a PNG.", 300),
        FORCE,
        CONFIG,
    ),
    **{f"simulate {name}": options for name, options in SIMULATIONS.items()},
    "list": (FORMAT,),
}


def options_of(command: str) -> Mapping[str, Option]:
    """Return the options of a command, or of all sub-commands of a group, by name."""
    if command in OPTIONS:
        return {option.name: option for option in OPTIONS[command]}
    inside = [name for name in OPTIONS if name.partition(" ")[0] == command]
    return {option.name: option for name in inside for option in OPTIONS[name]}
