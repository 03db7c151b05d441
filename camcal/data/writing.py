"""Writing points to files; `camcal.system.writing` has the functions that write any file."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from camcal.errors import UsageError
from camcal.system.text import cell
from camcal.system.writing import atomic_write, check_writable, is_special

__all__ = ["atomic_write", "check_writable", "is_special", "write_points"]

if TYPE_CHECKING:  # numpy stays out: the commands check their output before they load anything heavy
    from camcal.data.observations import Correspondences, View


def write_points(
    path: str | os.PathLike, correspondences: Correspondences, force: bool = False, view_column: str = "view"
) -> None:
    """Write correspondences as CSV, `view,id,X,Y,Z,u,v,sigma,printed`; `id` and `sigma` if the views have them.

    `printed` is 1 in every row of points that were found on a printed target; of others the column is left out.

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
    printed = ",1" if correspondences.is_printed else ""
    out.write(",".join([*columns, *["printed"] * bool(printed)]) + "\n")
    for view in views:
        name = _quoted(view.id)
        out.writelines(f"{name},{','.join(map(repr, row))}{printed}\n" for row in _rows(view))
    atomic_write(path, out.getvalue(), force)


def _rows(view: View) -> Iterator[list[float]]:
    columns = [*view.xyz.T.tolist(), *view.uv.T.tolist()]
    if view.point_ids is not None:
        columns.insert(0, [int(i) for i in view.point_ids])
    if view.sigma is not None:
        columns.append(view.sigma.tolist())
    return map(list, zip(*columns, strict=True))


def _quoted(name: str) -> str:
    """The name as a CSV field; quoted also where a reader would strip it or treat it as a comment."""
    if not name.strip() or any(c in name for c in "\r\n\0"):
        raise UsageError(
            f"the view name {name!r} cannot be written to a CSV file.",
            "Names must be one line and not empty.",
        )
    name = cell(name)
    if name.isprintable() and name == name.strip() and not any(c in name for c in "#%,;\"'\t "):
        return name
    out = io.StringIO()
    csv.writer(out, quoting=csv.QUOTE_ALL, lineterminator="").writerow([name])
    return out.getvalue()


def _all_or_none(views: tuple[View, ...], attribute: str, words: str) -> bool:
    have = [v.id for v in views if getattr(v, attribute) is not None]
    if have and len(have) < len(views):
        raise UsageError(
            f"{len(have)} of {len(views)} views have {words}; all or none are needed in one file.",
            "Write those views to a separate file.",
        )
    return bool(have)
