"""Correspondences from files: text tables, pairs of tables, and .npz archives."""

from __future__ import annotations

import os
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

from camcal.data.archive import read_archive
from camcal.data.columns import POINTS
from camcal.data.formats.checks import damage
from camcal.data.formats.files import split_name
from camcal.data.formats.source import Source
from camcal.data.observations import Correspondences, View
from camcal.data.pairs import read_pair
from camcal.data.point_files import POINT_FILES
from camcal.data.point_files.base import Board, Reader
from camcal.data.table import Table, read_table
from camcal.data.table_checks import check_duplicates, check_not_swapped
from camcal.errors import DataError, UsageError
from camcal.registry import load

#: endings of files that may be another program's points
FOREIGN = (".vnl", ".orpc", ".mat", ".bin", ".yml", ".yaml", ".xml", ".json")
#: bytes of a .txt that say whether it is a table, a gcp_list or an export of PhotoModeler
HEAD = 4096
#: so many rows without a header, each with another name, are points with names: views of a single point give nothing,
#: and fewer points no camera
LEAST_NAMED = 6
PathLike = str | os.PathLike


def read_points(
    *paths: PathLike,
    points3d: PathLike | None = None,
    points2d: PathLike | None = None,
    image_size: tuple[int, int] | None = None,
    board: tuple[int, int] | None = None,
    square: float = 1.0,
) -> Correspondences:
    """Read correspondences of 3D points and pixels.

    Parameters
    ----------
    *paths : path
        Tables with or without a header, or `.npz` archives; docs/input-formats.md describes them. A file
        without a view column is one view and names it. Views of different files are different views.
    points3d, points2d : path
        Instead: two tables whose rows correspond, one of points in the world and one of pixels.
    image_size : (width, height), optional
        Of the pictures, px. An archive may bring its own.
    board : (columns, rows), optional
        Inner corners of the board, for files that list corners without their place on it (.vnl).
    square : float
        Side of a square of that board.

    Returns
    -------
    Correspondences
        Views in the order of first appearance; `files` holds path and sha256 of each file.

    Raises
    ------
    DataError
        With file and line: what was found and what is needed.
    UsageError
        If no file is given, only one of a pair, or both kinds.
    """
    if points3d is not None or points2d is not None:
        if paths or points3d is None or points2d is None:
            raise UsageError(
                "points are read either from tables of X Y Z u v, or from a file of 3D points and one of 2D points.",
                "Give --points3d and --points2d without another file, or neither of them.",
            )
        joined, parts = read_pair(os.fspath(points3d), os.fspath(points2d))
        return _collect([joined], parts, image_size)
    if not paths:
        raise UsageError("no file of points is given.", "Name a CSV file, or --points3d and --points2d.")
    tables: list[Table] = []
    for given in paths:
        path = os.fspath(given)
        if any(Path(path).absolute() == Path(t.path).absolute() for t in tables):
            raise UsageError(f"'{path}' is given twice.", "Each file is read once.")
        if path.lower().endswith(".npz"):
            table, own_size = read_archive(path)
        else:
            table, own_size = _read_text(path, Board(board, square))
        image_size = _same_size(image_size, own_size, path)
        tables.append(table)
    return _collect(tables, tables, image_size)


def _read_text(path: str, board: Board) -> tuple[Table, tuple[int, int] | None]:
    """Read a table of points, or another program's point file; `FILE#CAMERA` selects one of several cameras."""
    file, camera = split_name(path)
    readers = _readers(file)
    source = Source(file) if readers else None
    for reader in readers:
        assert source is not None
        with damage(source, reader.title), np.errstate(divide="raise", over="raise", invalid="raise"):
            if reader.sniff(source):
                return reader.read(source, replace(board, camera=camera))
    return read_table(path, POINTS), None


def _readers(path: Path) -> list[Reader]:
    """The readers of other programs' points that a file may belong to; a table is not read into memory for this."""
    if path.suffix.lower() == ".txt" and path.is_file():
        with path.open("rb") as stream:
            start = Source(path, stream.read(HEAD))
        return [r for r in map(load, POINT_FILES.values()) if r.sniff(start)]
    return (
        [load(r) for r in POINT_FILES.values()] if path.suffix.lower() in FOREIGN and path.is_file() else []
    )


def _same_size(
    size: tuple[int, int] | None, own: tuple[int, int] | None, path: str
) -> tuple[int, int] | None:
    if size is None or own is None or tuple(size) == own:
        return size or own
    raise DataError(
        f"{path}: the pictures have {own[0]}x{own[1]} px; {size[0]}x{size[1]} is needed.",
        "All pictures of a camera must have the same size.",
    )


def _collect(tables: list[Table], files: list[Table], size: tuple[int, int] | None) -> Correspondences:
    """The views of all tables, checked, with unique names."""
    views: list[View] = []
    sources: list[str] = []
    for table in tables:
        check_not_swapped(table)
        check_duplicates(table)
        own = views_of(table)
        views += own
        sources += [table.path] * len(own)
    listed = tuple({"path": table.path, "sha256": table.sha256} for table in files)
    target = {"printed": True} if all(_is_printed(table) for table in tables) else None
    return Correspondences.from_views(_told_apart(views, sources), size, files=listed, target=target)


def _is_printed(table: Table) -> bool:
    """Return whether a table declares all its points as those of a printed target."""
    said = table.column("printed")
    if said is None:
        return False
    if not np.isin(said, (0, 1)).all():
        raise DataError(
            f"{table.path}: the column 'printed' holds a value other than 0 and 1.",
            "1 marks a point of a printed target, whose shape may be estimated; 0 a point whose position "
            "was measured.",
        )
    return bool(said.all())


def _told_apart(views: list[View], sources: list[str]) -> list[View]:
    """Prefix names that occur in several files with the file: left.csv:1, right.csv:1."""
    for prefix in (lambda path: Path(path).name, str):
        count = Counter(view.id for view in views)
        views = [
            replace(view, id=_prefixed(view.id, prefix(path))) if count[view.id] > 1 else view
            for view, path in zip(views, sources, strict=True)
        ]
    return views


def _prefixed(name: str, prefix: str) -> str:
    """The name with the file as a prefix; a view named after its file takes the file's longer name."""
    last = name.removeprefix(f"{Path(prefix).name}:")
    return prefix if last == Path(prefix).name else f"{prefix}:{last}"


def views_of(table: Table) -> list[View]:
    """The views of a table, in the order of first appearance."""
    n = len(table.values)
    xyz = np.zeros((n, 3))
    uv = np.empty((n, 2))
    for target, names in ((xyz, "XYZ"), (uv, "uv")):
        for k, name in enumerate(names):
            column = table.column(name)
            if column is not None:
                target[:, k] = column
    sigma, ids = table.column("sigma"), table.column("id")
    whole = View(
        Path(table.path).name,
        xyz,
        uv,
        None if sigma is None else sigma.copy(),  # a column of the table would keep all of it in memory
        None if ids is None else ids.astype(np.int64),
    )
    if table.view_index is None:
        return [whole]
    if not table.header and len(table.view_names) == n >= LEAST_NAMED:
        return [replace(whole, point_ids=np.arange(n))]
    index = table.view_index
    if (np.diff(index) < 0).any():  # the rows of a view are scattered
        order = np.argsort(index, kind="stable")
        whole, index = whole.take(order), index[order]
    ends = np.searchsorted(index, np.arange(1, len(table.view_names)))
    bounds = [0, *ends.tolist(), n]
    columns = whole.xyz, whole.uv, whole.sigma, whole.point_ids
    return [
        View(name, *(None if c is None else c[a:b] for c in columns))  # type: ignore[arg-type]
        for name, a, b in zip(table.view_names, bounds, bounds[1:], strict=False)
    ]
