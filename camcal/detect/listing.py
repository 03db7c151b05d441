"""The files that the arguments of the command line name."""

from __future__ import annotations

import glob
import os
import re
import shlex
import zipfile
from collections import Counter
from collections.abc import Iterable
from pathlib import Path, PurePath, PurePosixPath

from camcal.detect.frames import FILMS, is_film
from camcal.detect.pages import page_count, page_count_in
from camcal.detect.sources import ARCHIVES, RAW, exists
from camcal.errors import DataError
from camcal.system.text import listed, readable

#: extensions of the files that are read from a folder
PICTURES = (
    ".jpg", ".jpeg", ".jpe", ".jfif", ".jp2", ".heic", ".heif", ".hif", ".png", ".tif", ".tiff", ".bmp", ".dib",
    ".webp", ".avif", ".pgm", ".ppm", ".pbm", ".pnm", ".pfm", ".exr", ".hdr", ".sr", ".ras",
)  # fmt: skip

#: first bytes of JPEG, PNG, TIFF, BMP, binary PGM and PPM
BEGINNINGS = (b"\xff\xd8\xff", b"\x89PNG\r\n", b"II*\0", b"MM\0*", b"BM", b"P5", b"P6")
MOST_NAMED = 6  #: folders that an error message names


def list_pictures(paths: Iterable[str | os.PathLike]) -> list[Path]:
    """The files that folders, patterns and names refer to, each once; folders in natural order.

    A file that is named is taken whatever its extension; from a folder (or a zip archive) files with the extension of
    a picture are taken, or films if there are none. Each page of a multi-page TIFF file, and each frame of an animated
    PNG, WebP or AVIF file, is one picture.

    Raises
    ------
    DataError
        If a path does not exist, a pattern matches nothing, or a folder holds no picture.
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
        return _with_pages(_in_folder(path))
    if _is_archive(path):
        return _in_archive(path)
    if path.exists():
        return _with_pages([path])
    if exists(path):
        return [path]
    if any(c in str(path) for c in "*?["):
        matches = [Path(p) for p in glob.glob(str(path), recursive=True)]  # noqa: PTH207 (any base)
        files = sorted((p for p in matches if p.is_file()), key=natural_order)
        if not files:
            raise DataError(
                f"no file matches '{path}'.",
                "Check the pattern; put it in quotes so that the shell does not expand it.",
            )
        return _with_pages(files)
    raise DataError(f"there is no file or folder '{path}'.", "Check the spelling.")


def _with_pages(files: list[Path]) -> list[Path]:
    """The files; one with several pages is replaced by its pages."""
    return [page for path in files for page in _pages(path, page_count(path))]


def _pages(path: Path, count: int) -> list[Path]:
    """The names of the pages of a file; its own name if it has only one."""
    return [path] if count == 1 else [path.with_name(f"{path.name}#{n}") for n in range(count)]


def _is_archive(path: Path) -> bool:
    return path.suffix.lower() in ARCHIVES and path.is_file()


def _in_archive(archive: Path) -> list[Path]:
    """The pictures in an archive, named as if the archive were a folder."""
    try:
        with zipfile.ZipFile(archive) as opened:
            names = _entries(opened)
            pages = {archive / n: page_count_in(opened, n) for n in names if is_picture(PurePosixPath(n))}
    except (OSError, zipfile.BadZipFile) as error:
        raise DataError(
            f"the archive '{archive}' cannot be read: {error}.", "Unpack it, and name the folder."
        ) from None
    films = [n for n in names if PurePosixPath(n).suffix.lower() in FILMS]
    if films and not pages:
        unpack = f"python -m zipfile -e {shlex.quote(str(archive))} {shlex.quote(archive.stem)}"
        raise DataError(
            f"the archive '{archive}' holds films, which are not read from archives: {listed(films, MOST_NAMED)}.",
            f"Unpack it, and name the films. Try: {unpack}",
        )
    if not pages:
        raise DataError(
            f"the archive '{archive}' holds no pictures among its {len(names)} files.",
            "Files such as .jpg, .png or .tif are read.",
        )
    return [page for path in sorted(pages, key=natural_order) for page in _pages(path, pages[path])]


def _entries(archive: zipfile.ZipFile) -> list[str]:
    """The names of the files in an archive, without those that macOS adds."""
    names = [e.filename for e in archive.infolist() if not e.is_dir()]
    return [n for n in names if not n.startswith("__MACOSX")]


def _left_in_archive(archive: Path) -> list[Path]:
    """The films and raw pictures in an archive, named as if it were a folder."""
    with zipfile.ZipFile(archive) as opened:
        names = [PurePosixPath(n) for n in _entries(opened)]
    return [archive / n for n in names if n.suffix.lower() in (*FILMS, *RAW)]


def is_picture(path: PurePath) -> bool:
    """Return whether a name has the extension of a picture."""
    return path.suffix.lower() in PICTURES and not path.name.startswith(".")


def _in_folder(folder: Path) -> list[Path]:
    try:
        entries = list(folder.iterdir())
    except OSError as error:
        raise DataError(f"the folder '{folder}' cannot be read: {error.strerror}.") from error
    files = [p for p in entries if not p.name.startswith(".") and p.is_file()]
    for kind in (is_picture, _begins_like_a_picture, is_film, _is_raw):
        chosen = [p for p in files if kind(p)]
        if chosen:
            return sorted(chosen, key=natural_order)
    raise _no_pictures(folder, entries)


def left_in_folders(paths: Iterable[str | os.PathLike]) -> list[Path]:
    """The films and raw pictures that `list_pictures` skips in folders and archives because there are other
    pictures.
    """
    named = list(map(Path, paths))
    left = [p for archive in filter(_is_archive, named) for p in _left_in_archive(archive)]
    for folder in filter(Path.is_dir, named):
        listed_files = _in_folder(folder)
        if not (is_film(listed_files[0]) or _is_raw(listed_files[0])):
            left += [p for p in folder.iterdir() if (is_film(p) or _is_raw(p)) and p.is_file()]
    return sorted((p for p in left if not p.name.startswith(".")), key=natural_order)


def _begins_like_a_picture(path: Path) -> bool:
    """Return whether the first bytes of a file without an extension are those of a picture."""
    if path.suffix:
        return False
    try:
        with path.open("rb") as stream:
            return stream.read(12).startswith(BEGINNINGS)
    except OSError:
        return False


def _is_raw(path: Path) -> bool:
    return path.suffix.lower() in RAW


def _no_pictures(folder: Path, entries: list[Path]) -> DataError:
    """The error for a folder without pictures; it names subfolders that contain some."""
    inside = sorted((p for p in entries if p.is_dir() and holds_pictures(p)), key=natural_order)
    if len(inside) == 1:
        return DataError(
            f"the folder '{folder}' itself contains no pictures.", f"Its subfolder does. Try: '{inside[0]}'"
        )
    if inside:
        names = listed([p.name for p in inside], MOST_NAMED)
        pairs = " ".join(shlex.quote(f"{p.name}={p}") for p in inside[:MOST_NAMED])
        return DataError(
            f"the folder '{folder}' itself contains no pictures; its subfolders do: {names}.",
            f"They appear to be from several cameras. Try: camcal rig {pairs} -o rig.yaml, or one folder at a time "
            f"(for pictures of one camera: '{folder}/*/*').",
        )
    among = f" among its {len(entries)} entries" if entries else "; it is empty"
    return DataError(
        f"the folder '{folder}' holds no pictures{among}.",
        "Name a folder with files such as .jpg, .png or .tif.",
    )


def holds_pictures(folder: Path) -> bool:
    """Return whether a folder directly contains pictures."""
    try:
        return any(is_picture(p) for p in folder.iterdir())
    except OSError:
        return False


def view_ids(paths: list[Path]) -> list[str]:
    """The id of each picture in the report: its name, preceded by its folder if two have the same name."""
    names = [p.name for p in paths]
    twice = {name for name, count in Counter(names).items() if count > 1}
    return [readable(str(p) if p.name in twice else p.name) for p in paths]
