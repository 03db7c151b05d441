"""gcp_list.txt of OpenDroneMap: a line with the projection, then `x y z u v picture [name]` for each mark."""

from __future__ import annotations

import numpy as np

from camcal.data.formats.source import Source
from camcal.data.point_files.base import Board, Reader, Size, table_of
from camcal.data.table import Table
from camcal.errors import DataError

FIRST = ("epsg:", "+proj", "wgs84 utm")
GEOGRAPHIC = ("epsg:4326", "+proj=longlat", "+proj=latlong", "+init=epsg:4326")


def _sniff(source: Source) -> bool:
    if source.suffix != ".txt" or not source.text:
        return False
    first = source.text.lstrip().partition("\n")[0].strip().lower()
    return first.startswith(FIRST)


def _read(source: Source, board: Board) -> tuple[Table, Size | None]:
    head, *lines = [line for line in (source.text or "").splitlines() if line.strip() and line[0] != "#"]
    if any(g in head.lower() for g in GEOGRAPHIC):
        raise DataError(
            f"{source.path}: coordinates in degrees ({head.strip()}) were found; a projection in metres is needed.",
            "Project the points first, for example to UTM.",
        )
    views: dict[str, list[list[float]]] = {}
    for number, line in enumerate(lines, 2):
        words = line.split()
        if len(words) < 6:
            raise DataError(
                f"{source.path}:{number}: {len(words)} fields; x y z u v picture are needed.",
                "Is it complete?",
            )
        try:
            views.setdefault(words[5], []).append([float(w) for w in words[:5]])
        except ValueError as error:
            raise DataError(f"{source.path}:{number}: {error}.", "Correct or remove that row.") from None
    rows = {name: np.array(own) for name, own in views.items()}
    return table_of(source, [(n, r[:, :3], r[:, 3:], None) for n, r in rows.items()]), None


READER = Reader("a gcp_list.txt", _sniff, _read)
