"""`camcal convert`: the same camera as another model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from camcal.cli.options import options
from camcal.cli.verbosity import note, verbosity_options
from camcal.errors import EstimationError, UsageError

FILE = click.Path(path_type=Path)
#: models that can stand for most others, for the message where one cannot
RICHER = ("kb4", "opencv8", "spline:12x9")


@click.command("convert")
@click.argument("camera", type=FILE, metavar="CAMERA")
@options("convert")
@verbosity_options
@click.pass_context
def command(ctx: click.Context, camera: Path, **options: Any) -> int:
    """Find the closest camera of another model, over the whole image.

    CAMERA is a report of camcal or a camera file of OpenCV. Where the other model cannot stand for it
    within --max-px, nothing is written and the exit code is 4.
    """
    from camcal.cli.job import command_line, output_is_free
    from camcal.cli.output import emit
    from camcal.report.camera import camera_document
    from camcal.report.document import load_camera, save

    if options["to_model"] is None:
        raise UsageError("no model is given to convert to.", "Try: --to-model opencv5")
    output_is_free(options)
    source = load_camera(camera)
    if options["image_size"] is not None:
        source = replace(source, image_size=options["image_size"])
    made, figures = _converted(source, options)
    found = camera_document(made, command_line(ctx), conversion={"from": str(camera), **figures})
    if options["output"] is not None:
        save(found, options["output"], options["force"])
        note(f"Camera written to {options['output']}.")
    emit(found, options["format"], lambda: _table(found))
    return 0


def _converted(source: Any, options: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
    from camcal.model import lenses
    from camcal.model.lenses.conversion import convert

    lens = lenses.make(options["to_model"], options["skew"] or source.lens.has_skew)
    found = convert(source, lens)
    worst = f"{found.max_px:.3g} px" if found.reached == 1 else f"{1 - found.reached:.1%} of the image lost"
    if not found.max_px <= options["max_px"]:
        raise EstimationError(
            f"no camera of model '{lens.name}' is within {options['max_px']:g} px of this one: the closest "
            f"differs by {found.rms_px:.3g} px rms, at worst {worst}.",
            f"Choose a model that can do more ({', '.join(m for m in RICHER if m != lens.name)}), "
            "or give a larger --max-px.",
        )
    figures = {"model": source.lens.name, "max_px": found.max_px, "rms_px": found.rms_px}
    return found.camera, {**figures, "part_without_ray": found.without_ray}


def _table(found: dict[str, Any]) -> Any:
    from rich.console import Group
    from rich.text import Text

    from camcal.cli.output import number, table

    made = found["conversion"]
    said = (
        f"{made['model']} -> {found['camera']['model']}: {number(made['rms_px'], 3)} px rms, "
        f"{number(made['max_px'], 3)} px at worst"
    )
    if made["part_without_ray"]:
        said += f"; {made['part_without_ray']:.1%} of the image has no ray in either"
    rows = [[name, p["value"]] for name, p in found["camera"]["parameters"].items()]
    return Group(Text(said), table(["parameter", "value"], rows))
