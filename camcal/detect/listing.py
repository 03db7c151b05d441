"""Which files the words on the command line mean."""

from __future__ import annotations

import glob
import os
import re
from collections.abc import Iterable
from pathlib import Path

from camcal.errors import DataError

#: endings of the files that a folder is searched for
PICTURES = (
    ".jpg", ".jpeg", ".jpe", ".jp2", ".png", ".tif", ".tiff", ".bmp", ".dib",
    ".webp", ".avif", ".pgm", ".ppm", ".pbm", ".pnm", ".pfm", ".exr", ".hdr", ".sr", ".ras",
)  # fmt: skip


def list_pictures(paths: Iterable[str | os.PathLike]) -> list[Path]:
    """The files that folders, patterns and names stand for, each once; folders in natural order.

    A file that is named is taken whatever its ending; in a folder those with the ending of a picture are.

    Raises
    ------
    DataError
        Where a path does not exist, a pattern matches nothing, or a folder holds no picture.
    """
    found: dict[Path, None] = {}
    for path in paths:
        found.update(dict.fromkeys(_expand(Path(path))))
    if not found:
        raise DataError("no pictures were given.", "Name a folder, files, or a quoted pattern.")
    return list(found)


def natural_order(path: Path) -> tuple:
    """A key that sorts `img2` before `img10`."""
    parts = re.split(r"(\d+)", str(path).lower())
    return tuple((0, int(p), "") if p.isdecimal() else (1, 0, p) for p in parts), str(path)


def _expand(path: Path) -> list[Path]:
    if path.is_dir():
        return _in_folder(path)
    if path.exists():
        return [path]
    if any(c in str(path) for c in "*?["):
        matches = [Path(p) for p in glob.glob(str(path), recursive=True)]  # noqa: PTH207 (any base)
        files = sorted((p for p in matches if p.is_file()), key=natural_order)
        if not files:
            raise DataError(f"no file matches '{path}'.", "Check the pattern; quote it against the shell.")
        return files
    raise DataError(f"there is no file or folder '{path}'.", "Check the spelling.")


def _in_folder(folder: Path) -> list[Path]:
    try:
        entries = list(folder.iterdir())
    except OSError as error:
        raise DataError(f"the folder '{folder}' cannot be read: {error.strerror}.") from error
    files = [
        p for p in entries if p.suffix.lower() in PICTURES and not p.name.startswith(".") and p.is_file()
    ]
    if not files:
        inside = f" among its {len(entries)} entries" if entries else "; it is empty"
        raise DataError(
            f"the folder '{folder}' holds no pictures{inside}.",
            "Name a folder with files such as .jpg, .png or .tif.",
        )
    return sorted(files, key=natural_order)


def view_ids(paths: list[Path]) -> list[str]:
    """What each picture is called in the report: its name, with its folder where two have the same name."""
    names = [p.name for p in paths]
    return [str(p) if names.count(p.name) > 1 else p.name for p in paths]
