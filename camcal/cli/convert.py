"""`camcal convert`: the same camera in another program's format, or as another model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from camcal.cli.options import options
from camcal.cli.verbosity import note, verbosity_options
from camcal.errors import EstimationError, UsageError

if TYPE_CHECKING:
    from camcal.data.formats.base import CameraFile

FILE = click.Path(path_type=Path)
#: models that can stand for most others, for the message where one cannot
RICHER = ("kb4", "opencv8", "spline:12x9")


@click.command("convert")
@click.argument("source", type=FILE, metavar="SRC")
@click.argument("target", type=FILE, metavar="DST", required=False)
@options("convert")
@verbosity_options
@click.pass_context
def command(ctx: click.Context, source: Path, target: Path | None, **options: Any) -> int:
    """Convert a camera to another program's format, or to another lens model.

    SRC and DST are camera files of any format; `camcal list formats` names them. Terms that DST cannot
    represent are an error that names them, unless --to-model refits the camera: then the largest difference
    over the image is printed, and nothing is written if it exceeds --max-px (exit code 4). With {camera} in its
    name, DST is one file for each camera.
    """
    target = _target(target, options)
    cameras = _source(source, options)
    if target is not None and _format_name(target, options) == "dlt":
        cameras = _in_its_view(cameras, source)
    figures: dict[str, Any] = {"from": str(source)}
    if options["to_model"] is not None:
        cameras, more = _refitted(cameras, options, _is_square(target, options))
        figures |= more
    document = _document(ctx, cameras, figures)
    if target is not None:
        document["conversion"]["written"] = _write(document, cameras, target, options)
    from camcal.cli.output import emit

    emit(document, options["format"], lambda: _table(document))
    return 0


def _target(target: Path | None, options: dict[str, Any]) -> Path | None:
    """DST, or --output instead; checked before any work is done."""
    if target is not None and options["output"] is not None:
        raise UsageError("both DST and --output are given.", "Give one of them.")
    target = target or options["output"]
    if target is None:
        if options["to_model"] is None:
            raise UsageError(
                "neither a file to write nor a model to convert to is given.",
                "Try: camcal convert SRC cam.yml, or --to-model opencv5",
            )
        return None
    from camcal.data.writing import check_writable

    if "{camera}" not in str(target):
        check_writable(target, options["force"])
    if _format_name(target, options) != "camcal":
        from camcal.data.formats.files import target_format

        target_format(target, options["to"])
    return target


def _format_name(target: Path, options: dict[str, Any]) -> str | None:
    from camcal.data.formats import format_of

    return options["to"] or format_of(target)


def _source(source: Path, options: dict[str, Any]) -> CameraFile:
    """The cameras to convert, with the image size if the command line gives it."""
    from camcal.data.formats import files

    found = files.read(source, options["source_format"], options["image_size"])
    if options["camera"] is not None:
        found = files.select(found, options["camera"], str(source))
    for text in found.notes:
        note(f"{source}: {text}")
    for named in found.cameras:
        files.check_size(named.camera, options["image_size"], str(source))
    return found


def _in_its_view(cameras: CameraFile, source: Path) -> CameraFile:
    """The camera of a report of one view with its pose in the frame of the points; others unchanged."""
    if cameras.has_poses or len(cameras.cameras) != 1:
        return cameras
    from camcal.errors import DataError
    from camcal.report.placed import load_placed

    try:
        (placed,) = load_placed(source)
    except DataError:
        return cameras
    return replace(cameras, cameras=(replace(cameras.cameras[0], pose=placed.pose),))


def _is_square(target: Path | None, options: dict[str, Any]) -> bool:
    """Return whether the target format supports --to-model only with a single focal length, fx = fy."""
    name = None if target is None else _format_name(target, options)
    if name in (None, "camcal"):
        return False
    from camcal.data.formats.files import named_format
    from camcal.data.formats.terms import room
    from camcal.model import lenses

    wanted = lenses.make(options["to_model"]).name
    rooms = [r for r in map(room, named_format(str(name)).models) if lenses.make(r.spec).name == wanted]
    return bool(rooms) and all(r.square for r in rooms)


def _refitted(
    cameras: CameraFile, options: dict[str, Any], square: bool
) -> tuple[CameraFile, dict[str, Any]]:
    """Every camera refitted as the closest one of --to-model; the figures are those of the worst."""
    made = [_closest(named.camera, options, square) for named in cameras.cameras]
    refitted = tuple(replace(c, camera=found.camera) for c, found in zip(cameras.cameras, made, strict=True))
    worst = max(made, key=lambda found: found.max_px)
    figures = {
        "model": cameras.cameras[0].camera.lens.name,
        "max_px": worst.max_px,
        "rms_px": max(found.rms_px for found in made),
        "part_without_ray": max(found.without_ray for found in made),
    }
    return replace(cameras, cameras=refitted), figures


def _closest(source: Any, options: dict[str, Any], square: bool) -> Any:
    from camcal.model import lenses
    from camcal.model.lenses.conversion import convert

    lens = lenses.make(options["to_model"], options["skew"] or source.lens.has_skew)
    found = convert(source, lens, square)
    worst = f"{found.max_px:.3g} px" if found.reached == 1 else f"{1 - found.reached:.1%} of the image lost"
    if not found.max_px <= options["max_px"]:
        raise EstimationError(
            f"no camera of model '{lens.name}' is within {options['max_px']:g} px of this one: the closest "
            f"differs by {found.rms_px:.3g} px rms, at worst {worst}.",
            f"Choose a more general model ({', '.join(m for m in RICHER if m != lens.name)}), "
            "or give a larger --max-px.",
        )
    return found


def _document(ctx: click.Context, cameras: CameraFile, figures: dict[str, Any]) -> dict[str, Any]:
    from camcal.cli.job import command_line
    from camcal.data.formats.files import exact
    from camcal.report.camera import cameras_document

    for named in cameras.cameras:
        exact(named.camera)
    return cameras_document(cameras, command_line(ctx), conversion=figures)


def _write(
    document: dict[str, Any], cameras: CameraFile, target: Path, options: dict[str, Any]
) -> list[dict[str, Any]]:
    """Write DST; return what was written, with the difference after reading it back."""
    name = _format_name(target, options)
    if name == "camcal":
        from camcal.report.document import save

        save(document, target, options["force"])
        note(f"Camera written to {target}.")
        return [{"path": str(target), "format": "camcal", "max_px": 0.0}]
    from camcal.data.formats import files

    form = files.target_format(target, name)
    if cameras.has_poses and len(cameras.cameras) > 1 and not (form.poses and "{camera}" not in str(target)):
        held = (
            "; R and P hold the rectification of the pair"
            if form.rectified and len(cameras.cameras) == 2
            else ""
        )
        note(f"The poses between the cameras are not written: {form.title} cannot store them{held}.")
    made = []
    for path, gap in files.write(target, cameras, name, options["force"]).items():
        note(f"Camera written to {path} ({form.name}): it reads back within {gap.max_px:.1g} px.")
        made.append({"path": path, "format": form.name, "max_px": gap.max_px})
    return made


def _table(found: dict[str, Any]) -> Any:
    from rich.console import Group
    from rich.text import Text

    from camcal.cli.output import number, table

    made = found["conversion"]
    cameras = found.get("cameras") or {"camera": found["camera"]}
    parts = []
    if "max_px" in made:
        said = (
            f"{made['model']} -> {next(iter(cameras.values()))['model']}: {number(made['rms_px'], 3)} px rms, "
            f"{number(made['max_px'], 3)} px at worst"
        )
        if made["part_without_ray"]:
            said += f"; {made['part_without_ray']:.1%} of the image has no ray in either"
        parts.append(Text(said))
    for name, entry in cameras.items():
        rows = [[n, p["value"]] for n, p in entry["parameters"].items()]
        title = f"{name} ({entry['model']})" if len(cameras) > 1 else None
        parts.append(table(["parameter", "value"], rows, title))
    return Group(*parts)
