"""The options that commands share, each written once.

Every option takes its value from the flag, else from the environment (`CAMCAL_MAX_RMS` for `--max-rms`), else
from the configuration file, else from its default; `camcal.cli.settings` says where a value came from.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from camcal.cli import params
from camcal.cli.settings import SettingOption, read_config

Decorator = Callable[[Any], Any]


def option(*names: str, **kwargs: Any) -> Decorator:
    """`click.option` that also reads `CAMCAL_<NAME>` and says where a bad value stands."""
    long = next(name for name in names if name.startswith("--")).partition("/")[0]
    kwargs.setdefault("envvar", "CAMCAL_" + long.strip("-").replace("-", "_").upper())
    kwargs.setdefault("cls", SettingOption)
    kind = kwargs.get("type")
    if isinstance(
        kind, (click.IntRange, click.FloatRange)
    ):  # click calls them "integer range" and "float range"
        kind.name = "whole number" if isinstance(kind, click.IntRange) else "number"
    return click.option(*names, **kwargs)


def group_of(*decorators: Decorator) -> Decorator:
    """Apply several options as one decorator, in the order in which they are to stand in the help."""

    def apply(function: Any) -> Any:
        for decorate in reversed(decorators):
            function = decorate(function)
        return function

    return apply


def _lenses() -> Any:
    from camcal.model.lenses import LENSES

    return LENSES


def _lenses_or_auto() -> Any:
    return (*_lenses(), "auto")


def _optimizers() -> Any:
    from camcal.solve.optimizers import OPTIMIZERS

    return OPTIMIZERS


def _targets() -> Any:
    from camcal.detect.targets import TARGETS

    return TARGETS


def _robust_methods() -> Any:
    from camcal.solve.robust import METHODS

    return METHODS


def _board_shapes() -> Any:
    from camcal.solve.board import KINDS

    return ("flat", *KINDS, "auto")


def _merge_fixed(ctx: click.Context, param: click.Parameter, values: tuple[dict, ...]) -> dict:
    """Merge repeated `--fix` into one; the type refuses a parameter held at two values."""
    parts = [(f"{name}={held}" if held is not None else name) for one in values for name, held in one.items()]
    return params.FIX.convert(parts, param, ctx)


model_option = option(
    "--model", "-m", type=params.SpecType("model", _lenses), default="opencv5", show_default=True,
    metavar="NAME[:ARGS]", help="Camera model; `camcal list models` names them.",
)  # fmt: skip
calibrated_model_option = option(
    "--model", "-m", type=params.SpecType("model", _lenses_or_auto), default="opencv5", show_default=True,
    metavar="NAME[:ARGS]|auto",
    help="Camera model; `camcal list models` names them; auto takes the one that `camcal select` would.",
)  # fmt: skip
skew_option = option("--skew", is_flag=True, help="Estimate the skew of the pixel axes too.")
fix_option = option(
    "--fix", type=params.FIX, multiple=True, callback=_merge_fixed, metavar="NAME[=VALUE],...",
    help="Hold parameters, at VALUE or where they start; `aspect` means fy = fx.",
)  # fmt: skip
image_size_option = option(
    "--image-size", type=params.IMAGE_SIZE, metavar="WxH", help="Size of the pictures in px, such as 640x480."
)
robust_option = option(
    "--robust", type=params.SpecType("robust method", _robust_methods), default="auto", show_default=True,
    metavar="METHOD",
    help="What is done about outliers: none, auto (which looks for them first), or the name of a loss.",
)  # fmt: skip
board_shape_option = option(
    "--board-shape", type=params.ShapeType("board shape", _board_shapes), default="flat", show_default=True,
    metavar="SHAPE|REPORT",
    help="The board's shape: flat as designed; estimated too: bowl, print, free (each point), or auto, which "
    "believes a shape only if views held out do; or the report that found it.",
)  # fmt: skip
optimizer_option = option(
    "--optimizer", type=params.SpecType("optimizer", _optimizers), default="lm", show_default=True,
    metavar="NAME", help="What minimises the reprojection error; `camcal list optimizers` names them.",
)  # fmt: skip
crosscheck_option = option(
    "--crosscheck/--no-crosscheck", default=True, show_default=True, help="Compare every stage with OpenCV."
)
holdout_option = option(
    "--holdout", type=click.IntRange(min=0), metavar="K",
    help="Calibrate K times without every K-th view and judge the camera on it; 4 where that is quick, "
    "0 leaves it out.",
)  # fmt: skip
max_rms_option = option(
    "--max-rms", type=click.FloatRange(min=0, min_open=True), metavar="PX",
    help="A gate: exit code 1 where rms_point is larger.",
)  # fmt: skip
seed_option = option(
    "--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of what is random."
)
output_option = option(
    "--output", "-o", type=click.Path(path_type=Path), metavar="FILE", help="Write the report (YAML) to FILE."
)
force_option = option("--force", "-f", is_flag=True, help="Overwrite an output that exists.")
format_option = option(
    "--format", type=params.Word(["table", "json", "yaml"]), default="table", show_default=True,
    help="What stdout gets; json and yaml are exactly one document.",
)  # fmt: skip
config_option = option(
    "--config", cls=click.Option, type=click.Path(path_type=Path), is_eager=True, expose_value=False,
    callback=read_config, metavar="FILE", help="Read options from FILE (YAML) instead of ./camcal.yaml.",
)  # fmt: skip

target_option = option(
    "--target", type=params.SpecType("target", _targets), metavar="SPEC",
    help="Target with its sizes, such as checkerboard:9x6:25mm; `camcal list targets` names them.",
)  # fmt: skip
board_option = option(
    "--board", type=params.BOARD, metavar="CxR",
    help="Inner corners of the board, columns x rows, such as 9x6; found from the pictures where left out.",
)  # fmt: skip
square_option = option(
    "--square", type=params.LENGTH, metavar="LENGTH",
    help="Side of a square, such as 25mm; without it lengths are in squares.",
)  # fmt: skip
jobs_option = option(
    "--jobs", "-j", type=click.IntRange(min=1), metavar="N",
    help="Processes that read pictures; as many as there are cores by default.",
)  # fmt: skip
cache_option = option(
    "--cache/--no-cache", default=True, show_default=True, help="Keep and reuse what was found in a picture."
)

seconds_option = option(
    "--seconds", type=click.FloatRange(min=0, min_open=True), default=1.0, show_default=True, metavar="S",
    help="Processor time to search one picture; past it, the picture counts as not found.",
)  # fmt: skip

#: How a board is found in pictures.
board_options = group_of(
    target_option, board_option, square_option, jobs_option, seconds_option, cache_option
)
normalise_option = option(
    "--normalise/--no-normalise", default=True,
    help="Centre and scale coordinates and columns at every stage; off only shows what that is worth.",
)  # fmt: skip
trace_option = option(
    "--trace", type=click.Path(path_type=Path), metavar="FILE",
    help="Write iteration, cost, evaluations and seconds of each step of the refinement to FILE (CSV).",
)  # fmt: skip

#: What a calibration is, whatever its input.
calibration_options = group_of(
    calibrated_model_option,
    skew_option,
    fix_option,
    optimizer_option,
    robust_option,
    board_shape_option,
    crosscheck_option,
    holdout_option,
    max_rms_option,
    seed_option,
    normalise_option,
    trace_option,
)
#: Where results go and where options come from.
report_options = group_of(output_option, force_option, format_option, config_option)
