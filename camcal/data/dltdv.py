"""Digitised points of DLTdv, Argus and easyWand (xypts): one row per frame, columns pt1_cam1_X, pt1_cam1_Y, ..."""

from __future__ import annotations

import re
from collections.abc import Sequence

_HEAD = re.compile(r"\s*pt(\d+)_cam(\d+)_([XY])\s*", re.I)


def is_xypts(header: Sequence[str]) -> bool:
    """Return whether the header of a table is that of such a file."""
    return len(header) >= 2 and all(_HEAD.fullmatch(h) for h in header if h.strip())


def as_long(rows: Sequence[tuple[int, list[str]]]) -> list[tuple[int, list[str]]]:
    """The rows of a table camera,view,point,u,v; points that were not digitised (NaN) are omitted.

    Parameters
    ----------
    rows : (line number, fields), the header first
        A point of each frame is a point of its own; it is named `pt1` where there is one frame, else `7:pt1`.
    """
    (first, header), *frames = rows
    places: dict[tuple[str, str], dict[str, int]] = {}
    for i, name in enumerate(header):
        found = _HEAD.fullmatch(name)
        if found:
            places.setdefault((found[1], found[2]), {})[found[3].upper()] = i
    made = [(first, ["camera", "view", "point", "u", "v"])]
    for frame, (line, fields) in enumerate(frames, 1):
        for (point, camera), at in places.items():
            words = [fields[at[c]].strip() if c in at and at[c] < len(fields) else "nan" for c in "XY"]
            if not any(w.lower() in ("nan", "") for w in words):
                name = f"pt{point}" if len(frames) == 1 else f"{frame}:pt{point}"
                made.append((line, [camera, str(frame), name, *words]))
    return made
