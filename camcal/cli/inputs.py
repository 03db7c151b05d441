"""Checks that an input is of the kind that a command accepts: pictures or tables of points."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

from camcal.cli.job import is_table
from camcal.errors import DataError

#: in the name of an input: a pattern, a page or a frame, numbered frames, an address
_MORE = frozenset("*?[#%:")


def refuse_missing(paths: Sequence[str | Path]) -> None:
    """Raise a DataError for the first input that does not exist, before anything is imported to read it.

    Names that may stand for something else than a file are left to those who read them.
    """
    for path in map(Path, paths):
        standing = next((p for p in (path, *path.parents) if p.exists()), Path())
        inside = standing != path and standing.is_file()  # an archive
        if not path.exists() and not inside and str(path) != "-" and not _MORE & set(str(path)):
            raise DataError(f"there is no file or folder '{path}'.", "Check the spelling and the folder.")


def refuse_tables(paths: Sequence[str | Path]) -> None:
    """Raise a DataError that names the right command if there is a table of points among pictures."""
    refuse_missing(paths)
    tables = [str(p) for p in paths if is_table(p)]
    if tables:
        raise DataError(
            f"'{tables[0]}' is a table of points; pictures are needed.",
            f"Try: camcal estimate {' '.join(tables)}",
        )


def refuse_pictures(paths: Sequence[str | Path]) -> None:
    """Raise a DataError that names the right command if a picture, a film or a folder was given instead of a
    table.
    """
    refuse_missing(paths)
    others = [Path(p) for p in paths if not is_table(p)]
    if not others:
        return
    from camcal.detect.frames import is_film
    from camcal.detect.listing import holds_pictures, is_picture
    from camcal.detect.sources import ARCHIVES, split

    kinds = {
        "a folder of pictures": lambda path: path.is_dir() and holds_pictures(path),
        "an archive": lambda path: path.suffix.lower() in ARCHIVES,
        "a film": is_film,
        "a frame of a film": lambda path: is_film(split(path)[0]),
        "a picture": lambda path: is_picture(split(path)[0]),
    }
    for path in others:
        what = next((kind for kind, holds in kinds.items() if holds(path)), None)
        if what:
            raise DataError(
                f"'{path}' is {what}; a table of points is needed.",
                f"Try: camcal checkerboard {shlex.quote(str(path))}",
            )
