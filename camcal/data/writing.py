"""Writing files: complete or not at all, and never over another file unasked."""

from __future__ import annotations

import contextlib
import csv
import glob
import io
import os
import secrets
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from camcal.errors import UsageError

if TYPE_CHECKING:  # numpy stays out: the commands check their output before they load anything heavy
    from camcal.data.observations import Correspondences, View


def check_writable(path: str | os.PathLike, force: bool = False) -> None:
    """Raise now what `atomic_write` would raise later, so that a long job does not fail at its end.

    Raises
    ------
    UsageError
        Where the file exists and `force` is false, where it is a folder, or where its folder is missing or
        read-only.
    """
    target = Path(path)
    if target.is_dir():
        raise UsageError(f"cannot write '{target}': it is a folder.", "Give the name of a file.")
    folder = target.parent
    if not folder.is_dir():
        found = "is a file" if folder.exists() else "does not exist"
        raise UsageError(f"cannot write '{target}': the folder '{folder}' {found}.", "Make the folder first.")
    if is_special(target):
        if not os.access(target, os.W_OK):
            raise UsageError(f"cannot write '{target}': permission denied.", "Choose another file.")
        return
    if not os.access(folder, os.W_OK | os.X_OK):
        raise UsageError(f"cannot write '{target}': the folder '{folder}' is read-only.", "Choose another.")
    if target.exists() and not force:
        raise UsageError(f"'{target}' exists already.", "Choose another name, or overwrite it with --force.")
    if target.exists() and not os.access(target, os.W_OK):
        raise UsageError(f"cannot write '{target}': the file is read-only.", "Choose another name.")


def readable(text: str) -> str:
    """The text as UTF-8 can hold it: bytes of a file's name that are none become `\\xe9`."""
    try:
        text.encode("utf-8")
    except UnicodeEncodeError:
        return text.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")
    return text


def atomic_write(path: str | os.PathLike, content: str | bytes, force: bool = False) -> None:
    """Write a file so that it is there in full or not at all.

    The content goes to a temporary file in the same folder, which then takes the target's name; a process
    that reads meanwhile sees the old file or the new one. Text is written as UTF-8 with the line ends it has.
    A device or a pipe (`/dev/stdout`) is written to directly. A symbolic link stays; its target is replaced.

    Raises
    ------
    UsageError
        As `check_writable`, or where the system refuses to write (a full disk).
    """
    check_writable(path, force)
    data = readable(content).encode("utf-8") if isinstance(content, str) else content
    target = Path(path)
    try:
        if is_special(target):
            target.write_bytes(data)
        else:
            _replace(target.resolve(), data, force)
    except FileExistsError:
        raise UsageError(f"'{target}' exists already.", "Another program made it meanwhile.") from None
    except OSError as error:
        raise UsageError(f"cannot write '{target}': {_reason(error)}.", "Choose another place.") from error


def write_points(
    path: str | os.PathLike, correspondences: Correspondences, force: bool = False, view_column: str = "view"
) -> None:
    """Write correspondences as CSV, `view,id,X,Y,Z,u,v,sigma`; `id` and `sigma` where the views have them.

    `view_column` heads the first column: `file` for what was found in pictures. A path that ends in `.npz` gets an
    archive, one in `.vnl` the corners in mrcal's form.
    `camcal.data.points.read_points` reads back the same numbers to the last bit.

    Raises
    ------
    UsageError
        As `atomic_write`; where the name of a view is empty or holds a line break; or where only some
        of the views have ids or sigmas.
    """
    check_writable(path, force)
    views = correspondences.views
    suffix = Path(path).suffix.lower()
    if suffix in (".npz", ".vnl"):
        from camcal.data.point_files import written

        make = written.archive if suffix == ".npz" else written.vnl
        atomic_write(path, make(correspondences), force)
        return
    with_id = _all_or_none(views, "point_ids", "ids")
    with_sigma = _all_or_none(views, "sigma", "sigmas")
    out = io.StringIO()
    columns = [view_column, *["id"] * with_id, "X", "Y", "Z", "u", "v", *["sigma"] * with_sigma]
    out.write(",".join(columns) + "\n")
    for view in views:
        name = _quoted(view.id)
        out.writelines(f"{name},{','.join(map(repr, row))}\n" for row in _rows(view))
    atomic_write(path, out.getvalue(), force)


def _rows(view: View) -> Iterator[list[float]]:
    columns = [*view.xyz.T.tolist(), *view.uv.T.tolist()]
    if view.point_ids is not None:
        columns.insert(0, [int(i) for i in view.point_ids])
    if view.sigma is not None:
        columns.append(view.sigma.tolist())
    return map(list, zip(*columns, strict=True))


def _quoted(name: str) -> str:
    """The name as a CSV field; quoted also where a reader would strip it or take it for a comment."""
    if not name.strip() or any(c in name for c in "\r\n\0"):
        raise UsageError(
            f"the view name {name!r} cannot be written to a CSV file.", "Names are one line and not empty."
        )
    if name.isprintable() and name == name.strip() and not any(c in name for c in "#,;\"'\t "):
        return name
    out = io.StringIO()
    csv.writer(out, quoting=csv.QUOTE_ALL, lineterminator="").writerow([name])
    return out.getvalue()


def _all_or_none(views: tuple[View, ...], attribute: str, words: str) -> bool:
    have = [v.id for v in views if getattr(v, attribute) is not None]
    if have and len(have) < len(views):
        raise UsageError(
            f"{len(have)} of {len(views)} views have {words}; all or none are needed in one file.",
            "Write those views to a file of their own.",
        )
    return bool(have)


def is_special(path: Path) -> bool:
    """Whether a path is a device, a pipe or a socket: it is written to and never replaced."""
    return path.exists() and not path.is_file() and not path.is_dir()


def _reason(error: OSError) -> str:
    return (error.strerror or str(error)).lower()


def sweep(path: str | os.PathLike) -> None:
    """Remove what an `atomic_write` that was killed has left beside a file that only one process writes."""
    target = Path(path).resolve()
    for left in target.parent.glob(f".{glob.escape(target.name[:40])}.{'[0-9a-f]' * 16}.part"):
        left.unlink(missing_ok=True)


def _replace(target: Path, data: bytes, force: bool) -> None:
    """Write to a temporary file beside the target and rename it; leave nothing behind where that fails."""
    temporary = target.with_name(f".{target.name[:40]}.{secrets.token_hex(8)}.part")
    # The system takes the umask off 0o666, as for any new file; O_EXCL: never somebody else's file.
    handle = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o666)
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        if target.exists():
            if not force:
                raise FileExistsError(target)
            temporary.chmod(target.stat().st_mode & 0o777)
        temporary.replace(target)
    except BaseException:  # also on ^C: the half-written file must go
        with contextlib.suppress(FileNotFoundError):
            temporary.unlink()
        raise
