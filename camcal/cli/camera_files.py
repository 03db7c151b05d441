"""Camera files of other programs, written with a report: `--save-camera`, and `-o cam.yml`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from camcal.cli.verbosity import note

if TYPE_CHECKING:
    from camcal.model.camera import Camera
    from camcal.model.rig import Rig


def is_report(path: Path | None, options: Mapping[str, Any]) -> bool:
    """Return whether `--output` is a report; with an extension other than .yaml the main jobs write only the
    camera.
    """
    from camcal.data.formats import format_of

    return path is None or "save_camera" not in options or format_of(path) in (None, "camcal")


def targets(options: Mapping[str, Any]) -> list[tuple[str | None, Path]]:
    """The camera files to write and their formats: of `--save-camera`, and `--output` if it is one.

    The format is None where the ending of the name says it.
    """
    from camcal.data.formats import FORMATS

    output = options["output"]
    found: list[tuple[str | None, Path]] = [] if is_report(output, options) else [(None, output)]
    for given in options.get("save_camera") or ():
        format, colon, name = str(given).partition(":")
        named = bool(colon and name) and format in FORMATS
        found.append((format, Path(name)) if named else (None, Path(given)))
    return found


def check(options: Mapping[str, Any]) -> None:
    """Raise a UsageError if a camera file cannot be written, before any work is done."""
    from camcal.data.formats import format_of
    from camcal.data.writing import check_writable

    for format, path in targets(options):
        check_writable(path, options["force"])
        if (format or format_of(path)) != "camcal":
            from camcal.data.formats.files import target_format

            target_format(path, format)


def save(camera: Camera | Rig, options: Mapping[str, Any], command: list[str]) -> None:
    """Write the camera or the rig to each target, in the format that is named or that of its extension.

    Raises
    ------
    UsageError
        If a format has no room for a term of the camera, which it names.
    """
    for format, path in targets(options):
        from camcal.report.opening import save_camera

        save_camera(camera, path, format, force=options["force"], command=command)
        note(f"Camera written to {path}.")
