"""The options of a run that do not concern the computation: inputs, outputs, configuration."""

from __future__ import annotations

from dataclasses import replace

from camcal.settings.kinds import FilePath, OutputPath, Several, Text, Words
from camcal.settings.kinds import Switch as _Switch
from camcal.settings.option import Option
from camcal.settings.sizes import ImageSize

FILE = FilePath()
OUT = OutputPath()
SWITCH = _Switch()

IMAGE_SIZE = Option("image_size", ImageSize(), "Size of the pictures in px, such as 640x480.")
OUTPUT = Option("output", OUT, "Write the report (YAML) to FILE.", short="-o")
#: of the main jobs
OUTPUT_OR_CAMERA = replace(
    OUTPUT,
    help="Write the report (YAML) to FILE; with another extension (.yml, .xml, .json, ...) only the camera.",
)
SAVE_CAMERA = Option(
    "save_camera",
    Several(OUT),
    "Write the camera too, in the format of FILE's extension or in one of `camcal list formats` given "
    "before it (kalibr:cam.yaml); may be given several times.",
    metavar="[FORMAT:]FILE",
    repeated=True,
)
FORCE = Option("force", SWITCH, "Overwrite an output that exists.", False, short="-f")
FORMAT = Option(
    "format",
    Words(("table", "json", "yaml")),
    "Format of stdout; json and yaml are exactly one document.",
    "table",
)
CONFIG = Option("config", FILE, "Read options from FILE (YAML) instead of ./camcal.yaml.")
TRACE = Option(
    "trace",
    OUT,
    "Write iteration, cost, evaluations and seconds of each step of the refinement to FILE (CSV).",
)
PLOTS = Option("plots", OUT, "Write each chart to a file in DIR, in place of the page.", metavar="DIR")
POINTS3D = Option("points3d", FILE, "Table of the points (X Y Z) without images, with --points2d.")
POINTS2D = Option("points2d", FILE, "Table of their images (u v), in the same order.")
MODELS = Option(
    "models",
    Text(),
    "Specs, separated by ; or blanks (by commas if none has options); auto tries each kind once.",
    "auto",
    metavar="A;B;C|auto|all",
)

#: for CI systems
CI = (
    Option("junit", OUT, "Write the gates to FILE as JUnit XML."),
    Option(
        "annotations",
        Words(("github",)),
        "Write the gates to stderr as annotations of GitHub's workflows.",
    ),
    Option("summary", OUT, "Add a summary in Markdown to FILE, such as $GITHUB_STEP_SUMMARY."),
)

REPRODUCIBLE = Option(
    "reproducible",
    SWITCH,
    "The same report, byte for byte, from the same input, options and version: no times, one thread, "
    "inputs in the order of their names.",
    False,
)

#: where results go and where options come from
REPORT = (OUTPUT, FORCE, FORMAT, CONFIG)
#: the same of the main jobs
RESULT = (OUTPUT_OR_CAMERA, SAVE_CAMERA, FORCE, FORMAT, CONFIG, REPRODUCIBLE)
