"""`camcal undistort`: pictures as a lens without distortion would have taken them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from camcal.cli.options import options
from camcal.cli.verbosity import note, verbosity_options
from camcal.errors import UsageError


@click.command("undistort")
@click.argument("images", nargs=-1, metavar="IMAGES...")
@options("undistort")
@verbosity_options
@click.pass_context
def command(ctx: click.Context, images: tuple[str, ...], **options: Any) -> int:
    """Remove the distortion from pictures.

    IMAGES are files, folders, quoted patterns, films (each frame becomes a picture such as movie_000123.png) or
    frames of films (movie.mp4#123). The new pictures keep their names; camera.yaml in the same folder is the
    camera of the new pictures, with the largest rectangle without black (`undistortion: crop`). Unreadable
    pictures are reported and skipped (exit code 1). With --maps, no pictures are needed.
    """
    from camcal.cli.job import command_line
    from camcal.data.formats.files import check_size
    from camcal.detect.frames import is_film
    from camcal.detect.listing import list_pictures
    from camcal.detect.resample import written_name
    from camcal.model.lenses.undistort import undistortion
    from camcal.report.camera import camera_document
    from camcal.report.document import save
    from camcal.report.loading import load_camera

    source = load_camera(options["camera"], options["image_size"])
    check_size(source, options["image_size"], str(options["camera"]))
    if not images and not options["maps"]:
        raise UsageError(
            "no pictures are given.", "Name pictures or a folder, or ask for the maps alone: --maps maps.npz"
        )
    files, folder = list_pictures(images) if images else [], options["output"]
    # how many frames a film has is known at its end only; a frame never overwrites a file, either
    targets = [folder / written_name(f) for f in files if not is_film(f)]
    _check(targets, folder, options["force"])
    _check_maps(source, options)
    made = undistortion(source, options["keep"], options["size"], options["projection"])
    folder.mkdir(parents=True, exist_ok=True)
    figures = {"from": str(options["camera"]), "keep": str(options["keep"]), "black": made.black}
    figures["crop"] = _write_maps(made, source, options)
    document = camera_document(made.camera, command_line(ctx), undistortion=figures)
    save(document, folder / "camera.yaml", options["force"])
    failed, count = _resample_all(files, folder, source.image_size, made, options)
    if not images:
        return 0
    note(f"{count - failed} of {count} pictures written to {folder}; {made.black:.1%} of each is black.")
    return 1 if failed else 0


def _check_maps(source: Any, options: dict[str, Any]) -> None:
    from camcal.data.remap_files import check_ending, gstreamer, names
    from camcal.data.writing import check_writable

    for path in options["maps"]:
        check_ending(path)
        if path.suffix.lower() == ".gst":
            gstreamer(source)  # names the term that it has no room for
        for file in names(path):
            check_writable(file, options["force"])


def _write_maps(made: Any, source: Any, options: dict[str, Any]) -> dict[str, int] | None:
    """Write --maps; return the rectangle without black pixels, for the document."""
    import numpy as np

    from camcal.data.remap_files import contents, crop_box
    from camcal.data.writing import atomic_write

    size = source.image_size
    assert size is not None  # or there would be no map
    box = crop_box(made.u, made.v, size)
    more = {"matrix": made.camera.matrix, "crop": np.array(box or (0, 0, 0, 0))}
    for path in options["maps"]:
        for file, data in contents(path, made.u, made.v, size, source, **more).items():
            atomic_write(file, data, options["force"])
            note(f"Map written to {file}.")
    return None if box is None else dict(zip(("x", "y", "width", "height"), box, strict=True))


def _check(targets: list[Path], folder: Path, force: bool) -> None:
    """Raise an error for anything that would be overwritten, before any work is done."""
    from camcal.data.writing import check_writable

    if folder.exists() and not folder.is_dir():
        raise UsageError(f"'{folder}' is a file; a folder is needed.", "Try: -o undistorted")
    if not folder.exists():
        check_writable(folder, force)  # its own folder must be there
    names = [t.name for t in targets]
    twice = next((n for n in names if names.count(n) > 1), None)
    if twice is not None:
        raise UsageError(f"two of the pictures are called '{twice}'.", "Undistort one folder at a time.")
    if folder.exists():
        for path in (*targets, folder / "camera.yaml"):
            check_writable(path, force)


def _resample_all(
    files: list[Path], folder: Path, size: tuple[int, int] | None, made: Any, options: dict[str, Any]
) -> tuple[int, int]:
    """Resample every picture; return the number of failures, and of all pictures."""
    from camcal.cli.output import progress
    from camcal.detect.decode import UnreadableError
    from camcal.detect.resample import other_size, read_pictures, resample, write_picture, written_name

    failed = count = 0
    with progress("undistorting") as show:
        for count, (path, picture) in enumerate(read_pictures(files, size), 1):
            try:
                if isinstance(picture, UnreadableError):
                    raise picture
                if picture.shape[1::-1] != size:
                    raise UnreadableError(other_size(picture.shape[1::-1], size))
                out = resample(picture, made.u, made.v, options["interpolation"])
                write_picture(folder / written_name(path), out, options["force"])
            except UnreadableError as reason:
                failed += 1
                note(f"{path}: {reason}", -9)
            show(count, max(count, len(files)))
    return failed, count
