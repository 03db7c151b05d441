"""PhotoModeler's text export, in the form that DBAT reads: cameras, control points, object points and marks.

Header of five lines; six lines for each photo; then, each ended by an empty line, control points, object points
`id x y z sx sy sz` and marks `photo id u v su sv`. Photos are counted from 0; (0, 0) is the centre of the top-left
pixel. The points are those that PhotoModeler estimated. Source: DBAT, loadpm.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from camcal.data.formats.base import image_size
from camcal.data.formats.source import Source
from camcal.data.point_files.base import Array, Board, Reader, Size, table_of
from camcal.data.table import Table
from camcal.errors import DataError

#: numbers in lines 2 to 5 of the header, at least: tolerances, deviations, camera, deviations of it
HEAD = (2, 9, 10, 10)
#: lines of a photo after its name: orientation, deviations, covariances (may be empty), camera, deviations
PHOTO = 5


def _numbers(line: str) -> list[float]:
    try:
        return [float(w) for w in line.split()]
    except ValueError:
        return []


def _sniff(source: Source) -> bool:
    if source.suffix != ".txt" or not source.text:
        return False
    lines = source.text.splitlines()[:6]
    if len(lines) < 6 or any(len(_numbers(t)) < n for t, n in zip(lines[1:5], HEAD, strict=True)):
        return False
    first = lines[5].split()
    return len(first) >= 2 and first[0] == "0" and not _numbers(lines[5])


def _read(source: Source, board: Board) -> tuple[Table, Size | None]:
    lines = (source.text or "").splitlines()
    tolerances = _numbers(lines[1])
    size = image_size(*tolerances[2:4]) if len(tolerances) >= 4 else None
    left = iter(enumerate(lines[5:], 6))
    names = list(_photos(source, left))
    control = _block(source, left, 7)
    points = _block(source, left, 7)
    marks = _block(source, left, 6)
    known = {int(p[0]): p[1:4] for p in [*control, *points]}
    _no_smart_points(source, points)
    views = []
    for i, name in enumerate(names):
        own = marks[(marks[:, 0] == i) & np.isin(marks[:, 1], list(known))]
        ids = own[:, 1].astype(int)
        xyz = np.array([known[int(n)] for n in ids]).reshape(-1, 3)
        views.append((name, xyz, own[:, 2:4], ids))
    return table_of(source, views), size


def _photos(source: Source, left: Iterator[tuple[int, str]]) -> Iterator[str]:
    """The names of the photos, without their folders."""
    seen: dict[str, int] = {}
    for number, line in left:
        words = line.split(maxsplit=1)
        if not words:
            return
        if len(words) < 2 or not words[0].isdigit():
            raise DataError(
                f"{source.path}:{number}: the number and the name of a photo are needed.", "Is it complete?"
            )
        if len(list(itertools.islice(left, PHOTO))) < PHOTO:
            raise DataError(f"{source.path}: the file ends within the entry of a photo.", "Is it complete?")
        name = words[1].replace("\\", "/").rpartition("/")[2].strip()
        seen[name] = seen.get(name, 0) + 1
        yield name if seen[name] == 1 else f"{name}-{seen[name]}"


def _block(source: Source, left: Iterator[tuple[int, str]], width: int) -> Array:
    """The rows of a block (N, width), which ends with an empty line."""
    rows = []
    for number, line in left:
        if not line.strip():
            break
        row = _numbers(line)
        if len(row) != width:
            raise DataError(
                f"{source.path}:{number}: {len(row)} numbers; {width} are needed.", "Is it complete?"
            )
        rows.append(row)
    return np.array(rows).reshape(-1, width)


def _no_smart_points(source: Source, points: Array) -> None:
    """Reject two points with the same number: normal points and smart points are numbered separately."""
    numbers, count = np.unique(points[:, 0], return_counts=True)
    if (count > 1).any():
        raise DataError(
            f"{source.path}: point {int(numbers[count > 1][0])} is listed twice (as a normal and as a smart point).",
            "Export the project without its smart points.",
        )


READER = Reader("a text export of PhotoModeler", _sniff, _read)
