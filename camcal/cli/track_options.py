"""The options of `camcal track`: what concerns the method, and what concerns the run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from camcal.cli import params
from camcal.cli.options import config_option, fix_option, force_option, group_of, option, skew_option

#: frames between checkpoints, where all of them can be read again and where they cannot
FROM_FILE, FROM_PIPE = 1000, 1


def _names(attribute: str) -> Any:
    def table() -> Any:
        from camcal import track as tracking

        return getattr(tracking, attribute)

    return table


def _lenses() -> Any:
    from camcal.model.lenses import LENSES

    return LENSES


#: options that stand for a field of TrackOptions under the same name, and what they say
method_options = group_of(
    option(
        "--method",
        type=params.SpecType("method", _names("ESTIMATORS")),
        metavar="NAME",
        help="Estimator; `camcal list estimators` names them. [default: iekf with --camera, else kalman]",
    ),
    option(
        "--gain",
        type=params.SpecType("gain", _names("GAINS")),
        metavar="NAME",
        help="kalman, forgetting, fixed, mean or adaptive. [default: the method's own]",
    ),
    option(
        "--forgetting",
        type=click.FloatRange(0, 1, min_open=True),
        default=0.98,
        show_default=True,
        metavar="FACTOR",
        help="Factor per frame by which old frames lose weight.",
    ),
    option(
        "--alpha",
        type=click.FloatRange(0, 1, min_open=True),
        default=0.1,
        show_default=True,
        metavar="FRACTION",
        help="The fixed gain.",
    ),
    option(
        "--motion",
        type=params.SpecType("motion", _names("MOTION_SUMMARIES")),
        default="thermal",
        show_default=True,
        metavar="NAME",
        help="How the camera may move: fixed, thermal, zoom, pan, free.",
    ),
    option(
        "--drift",
        type=params.FIX,
        metavar="GROUP=VALUE,...",
        help="Figures in place of the motion's: focal, principal (px), rotation (deg), translation, ...",
    ),
    option("--velocity", is_flag=True, help="Constant velocity instead of a random walk."),
    option(
        "--sigma",
        type=click.FloatRange(min=0, min_open=True),
        metavar="PX",
        help="Noise of the image points; a factor where they bring sigmas. [default: estimated]",
    ),
    option("--learn-noise", is_flag=True, help="Estimate a factor of the noise where points bring sigmas."),
    option(
        "--gate",
        type=click.FloatRange(0, 0.5, min_open=True),
        default=1e-4,
        show_default=True,
        metavar="PROBABILITY",
        help="Of taking a good point for an outlier.",
    ),
    option(
        "--false-alarm",
        type=click.FloatRange(0, 0.1, min_open=True),
        default=1e-6,
        show_default=True,
        metavar="RATE",
        help="False alarms per frame of the change test.",
    ),
    option(
        "--min-points",
        type=click.IntRange(min=1),
        metavar="N",
        help="Frames with fewer are predicted only. [default: what the method needs]",
    ),
    option(
        "--rate",
        type=click.FloatRange(min=0, min_open=True),
        default=30.0,
        show_default=True,
        metavar="HZ",
        help="Frames per second that the drift refers to, where frames have times.",
    ),
    option(
        "--model",
        "-m",
        type=params.SpecType("model", _lenses),
        default="pinhole",
        show_default=True,
        metavar="NAME[:ARGS]",
        help="Lens of iekf, window and smoother; `camcal list models` names them.",
    ),
    skew_option,
    option(
        "--camera",
        type=click.Path(path_type=Path),
        metavar="FILE",
        help="Calibration to start from, with its lens.",
    ),
    fix_option,
    option(
        "--iterations",
        type=click.IntRange(min=1),
        default=4,
        show_default=True,
        metavar="N",
        help="Relinearisations of a frame, at most.",
    ),
    option(
        "--window",
        type=click.IntRange(min=2),
        default=10,
        show_default=True,
        metavar="FRAMES",
        help="Length of the sliding window.",
    ),
)
run_options = group_of(
    option(
        "--reorder",
        type=click.IntRange(min=0),
        default=0,
        show_default=True,
        metavar="FRAMES",
        help="Hold so many frames back to put late ones in their place.",
    ),
    option("--fail-on-change", is_flag=True, help="Exit code 1 where the camera has changed."),
    option(
        "--state",
        type=click.Path(path_type=Path),
        metavar="FILE",
        help="Checkpoint: written as the run goes on, taken up again where it exists.",
    ),
    option(
        "--state-every",
        type=click.IntRange(min=1),
        metavar="FRAMES",
        help=f"Between checkpoints. [default: {FROM_PIPE} from a pipe, else {FROM_FILE}]",
    ),
    option(
        "--output",
        "-o",
        type=click.Path(path_type=Path),
        metavar="FILE",
        help="Write the table to FILE. [default: stdout]",
    ),
    option(
        "--format",
        type=params.Word(["csv", "jsonl"]),
        help="Of the table. [default: jsonl where FILE ends in it, else csv]",
    ),
    option("--covariance", is_flag=True, help="Add the covariance of K, R, t to each row."),
    option(
        "--report", type=click.Path(path_type=Path), metavar="FILE", help="Write a summary (YAML) to FILE."
    ),
    option(
        "--plots",
        type=click.Path(path_type=Path),
        metavar="FOLDER",
        help="Draw the table into FOLDER (needs matplotlib).",
    ),
    option(
        "--reference",
        type=click.Path(path_type=Path),
        metavar="FILE",
        help="Report whose projection_matrix the plots compare with. [default: the last estimate]",
    ),
    force_option,
    config_option,
)
