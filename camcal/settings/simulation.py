"""The options of `camcal simulate`."""

from __future__ import annotations

from dataclasses import replace

from camcal.settings.calibration import MODEL, CalibrationOptions
from camcal.settings.detection import DetectionOptions
from camcal.settings.kinds import Assignments, Name, Real, Switch, Whole, Words
from camcal.settings.option import Option
from camcal.settings.run import CONFIG, FORCE, OUT, POINTS3D
from camcal.settings.sizes import ImageSize, LengthKind, Numbers

_SHARE = Real(0, 1)
_AMOUNT = Real(0)

_TARGET = replace(
    DetectionOptions.options()["target"],
    default="checkerboard:9x6:25mm",
    help="The target; `camcal list targets` names them.",
)
_CAMERA = (
    Option("model", MODEL, "Camera model; `camcal list models` names them.", "opencv5", short="-m"),
    Option(
        "values",
        Assignments("NAME=VALUE,...", "fx=800,k1=-0.1"),
        "Values of the camera's parameters; the others are taken from the model's first example.",
        flag="--set",
    ),
    Option("image_size", ImageSize(), "Size of the pictures; the example's by default."),
)
_NOISE = Option("noise", _AMOUNT, "Standard deviation of the noise of each coordinate, px.", 0.1)
_OUTLIERS = Option("outliers", _SHARE, "Fraction of the points that is moved by 5 to 60 px.", 0.0)
_POINT_NOISE = (
    _NOISE,
    _OUTLIERS,
    Option("clip", Switch(), "Omit points outside the picture.", True, off="--no-clip"),
)
_TABLE = Option("output", OUT, "Output file.", short="-o", metavar="FILE.csv", required=True)
_RUN = (CalibrationOptions.options()["seed"], FORCE, CONFIG)


def _poses(tilt: str) -> tuple[Option, ...]:
    """The number of simulated views, and how they vary."""
    return (
        Option("views", Whole(1), "Number of views.", 12),
        Option(
            "tilt",
            Numbers(2, tilt),
            "Angle between the line of sight and the target's normal, degrees.",
            tilt,
            metavar="LOW,HIGH",
        ),
        Option(
            "fill",
            Numbers(2, "0.45,0.8"),
            "Fraction of the picture that the target covers.",
            "0.45,0.8",
            metavar="LOW,HIGH",
        ),
    )


POINTS = (_TARGET, *_CAMERA, *_poses("5,45"), *_POINT_NOISE, _TABLE, *_RUN)

RIG = (
    Option("cells", Whole(2), "Points along an edge of a face.", 6),
    Option("spacing", LengthKind(), "Distance between neighbouring points.", "30mm"),
    replace(POINTS3D, help="Take these points (X Y Z) instead."),
    Option(
        "frame",
        Words(("world", "camera")),
        "Frame in which --points3d are given; `camera` needs --pose.",
        "world",
    ),
    Option(
        "pose",
        Numbers(6, "0,0,0,0,0,5"),
        "cam_from_world of a single view: rotation vector (rad), translation; random if not given.",
        metavar="RX,RY,RZ,TX,TY,TZ",
    ),
    *_CAMERA,
    *_poses("0,20"),
    *_POINT_NOISE,
    _TABLE,
    *_RUN,
)

IMAGES = (
    _TARGET,
    *_CAMERA,
    *_poses("5,45"),
    Option("blur", _AMOUNT, "Sigma of a Gaussian blur, px.", 0.8),
    Option("noise", _AMOUNT, "Grey levels of 8 bits.", 2.0),
    Option("uneven", Switch(), "Lighting that differs across and between pictures.", True, off="--even"),
    Option("vignetting", _SHARE, "Fraction of the light lost in the corners.", 0.2),
    Option("bow", Real(), "Height of the sheet's middle above its rim, in its unit.", 0.0),
    Option("bits", Words(("8", "16")), "16 needs --type png or tiff.", "8"),
    Option("extension", Words(("png", "jpg", "tiff")), "Format of the pictures.", "png", flag="--type"),
    replace(_TABLE, metavar="FOLDER"),
    *_RUN,
)

FRAMES = (
    Option(
        "kind",
        Name("kind of sequence", "camcal.track:SEQUENCES"),
        "How the camera moves: thermal, pan or zoom as that motion; static and knock do not move.",
        "knock",
    ),
    Option("frames", Whole(1), "Number of frames.", 300),
    Option("points", Whole(1), "Number of points, in a cube of side 2.", 50),
    replace(_NOISE, default=0.3),
    replace(_OUTLIERS, help="Fraction of the points at random positions in the picture."),
    Option("at", Whole(0, metavar="FRAME"), "Frame in which the camera is knocked. [default: half-way]"),
    Option("angle", Real(), "Rotation about y at that frame.", 0.3, metavar="DEGREES"),
    _TABLE,
    *_RUN,
)

#: sub-command -> its options
SIMULATIONS = {"points": POINTS, "rig": RIG, "images": IMAGES, "frames": FRAMES}
