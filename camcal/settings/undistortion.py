"""The options of the commands that resample pictures: undistort and rectify."""

from __future__ import annotations

from dataclasses import replace

from camcal.settings.kinds import Real, Several, Words
from camcal.settings.option import Option
from camcal.settings.run import CONFIG, FILE, FORCE, FORMAT, IMAGE_SIZE, OUT, OUTPUT
from camcal.settings.sizes import ImageSize, KeptField

INTERPOLATION = Option(
    "interpolation",
    Words(("nearest", "linear", "cubic", "lanczos")),
    "Interpolation between pixels.",
    "linear",
)

UNDISTORT = (
    Option("camera", FILE, "A camera file of any format.", short="-c", required=True),
    replace(OUTPUT, help="Output folder of the pictures.", metavar="FOLDER", required=True),
    Option(
        "keep",
        KeptField(),
        "The field that is kept: all pixels, the largest without black, or a horizontal field of view.",
        "all",
    ),
    Option("size", ImageSize(), "Size of the new pictures; by default that of the old ones."),
    Option(
        "projection",
        Words(("perspective", "equidistant")),
        "Straight lines stay straight, or equal angles have equal lengths (for fields above 160 degrees).",
        "perspective",
    ),
    INTERPOLATION,
    Option(
        "maps",
        Several(OUT),
        "Write the map too: .npz (u, v, matrix, crop), .exr (STMap), .pgm (two files for ffmpeg's remap) or "
        ".gst (settings of GStreamer's cameraundistort).",
        repeated=True,
    ),
    IMAGE_SIZE,
    FORCE,
    CONFIG,
)

RECTIFY = (
    replace(
        OUTPUT, help="Output folder of the pictures, maps and matrices.", metavar="FOLDER", required=True
    ),
    Option(
        "alpha",
        Real(0, 1),
        "0: the largest field without black in either picture; 1: all pixels of both; between: interpolated.",
        0.0,
    ),
    Option("size", ImageSize(), "Size of the new pictures; by default that of the old ones."),
    Option(
        "projection",
        Words(("auto", "perspective", "latitude-longitude")),
        "latitude-longitude is for wide lenses; auto uses it beyond 60 degrees from the axis.",
        "auto",
    ),
    INTERPOLATION,
    FORCE,
    FORMAT,
    CONFIG,
)
