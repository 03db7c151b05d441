"""Thumbnails of the pictures with their corners and residuals, where the files are still there."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from camcal.plan.solution import Solution
from camcal.report.charts.residuals import enlargement
from camcal.system.reading import is_file

Array = np.ndarray

WIDTH = 340
QUALITY = 62
#: more thumbnails than this are not shown: the worst views, and some of those that were not used
MOST_USED, MOST_OTHERS = 24, 8
MOST_NAMED = 6  #: pictures that have changed


@dataclass(frozen=True)
class Thumbnail:
    """A picture as a data URI, and what is drawn over it in the picture's own pixels."""

    id: str
    caption: str
    uri: str
    size: tuple[int, int]
    used: str  #: SVG path of dots
    rejected: str
    arrows: str


def thumbnails(solution: Solution, report: dict[str, Any], folder: Path) -> tuple[list[Thumbnail], str]:
    """Those that can be shown, and a sentence on the rest.

    Parameters
    ----------
    solution : Solution
    report : dict
        Its document: `inputs.files` say where the pictures were.
    folder : Path
        That of the report; paths that lead nowhere from the current folder are tried from there.
    """
    paths = _paths(report, folder)
    chosen = _chosen(report["views"])
    index = {v.id: i for i, v in enumerate(solution.observations.views)}
    scale = _scale(solution)
    made, changed = [], []
    for entry in chosen:
        picture = paths.get(entry["id"])
        if picture is None:
            continue
        try:
            found = _thumbnail(solution, entry, index.get(entry["id"]), picture, scale)
        except ChangedError:
            changed.append(entry["id"])
            continue
        if found is not None:
            made.append(found)
    missing = len(report["views"]) - len(made) - len(changed)
    said = f"Arrows: residuals, {scale:g} times enlarged."
    if changed:
        names = ", ".join(changed[:MOST_NAMED]) + ", ..." * (len(changed) > MOST_NAMED)
        said += f" {len(changed)} pictures are not those of the calibration any more, and not shown: {names}."
    if missing:
        said += (
            f" {missing} pictures are not shown: the worst come first, and files that are gone are left out."
        )
    return made, said


class ChangedError(Exception):
    """A file is not the picture of the calibration: its SHA-256 is another, or not known."""


def _paths(report: dict[str, Any], folder: Path) -> dict[str, tuple[Path, str | None]]:
    """Where the picture of each view is and the SHA-256 that it had, by the view's id."""
    found = {}
    names = {e["id"] for e in report["views"]}
    for file in report["inputs"]["files"] or []:
        for path in (Path(file["path"]), folder / file["path"], folder / Path(file["path"]).name):
            if is_file(path):
                known = [n for n in (str(file["path"]), path.name, *_tails(path)) if n in names]
                if known:
                    found[known[0]] = path, file.get("sha256")
                break
    return found


def _tails(path: Path) -> Iterator[str]:
    """`b/c.jpg`, `a/b/c.jpg`, ...: the ids of views whose names alone would not differ."""
    parts = path.parts
    for count in range(2, len(parts) + 1):
        yield "/".join(parts[-count:])


def _chosen(entries: list[dict[str, Any]]) -> list[dict[str, Any]]:
    used = sorted((e for e in entries if e["status"] == "used"), key=lambda e: -(e["rms_point"] or 0))
    others = [e for e in entries if e["status"] != "used"]
    return [*used[:MOST_USED], *others[:MOST_OTHERS]]


def _scale(solution: Solution) -> float:
    r = solution.used_residuals
    lengths = np.linalg.norm(r[np.isfinite(r).all(1)], axis=1)
    size = solution.camera.image_size
    return enlargement(lengths, 2.0 * (size[0] if size else 640)) if len(lengths) else 1.0


def _thumbnail(
    solution: Solution,
    entry: dict[str, Any],
    index: int | None,
    picture: tuple[Path, str | None],
    scale: float,
) -> Thumbnail | None:
    read = _read(*picture)
    if read is None:
        return None
    uri, size = read
    used = rejected = arrows = ""
    if index is not None:
        rows = solution.observations.slices[index]
        view, r, good = solution.observations.views[index], solution.residuals[rows], solution.used[rows]
        used, rejected = _dots(view.uv[good]), _dots(view.uv[~good])
        arrows = "".join(
            f"M{u:.1f} {v:.1f}l{du:.1f} {dv:.1f}"
            for (u, v), (du, dv) in zip(view.uv[good], scale * r[good], strict=True)
            if np.isfinite(du + dv)
        )
        caption = f"rms {entry['rms_point']:.3g} px, {entry['points'] - entry['rejected_points']} points"
    else:
        caption = entry["status"].replace("_", " ") + (f": {entry['reason']}" if entry["reason"] else "")
    return Thumbnail(entry["id"], caption, uri, size, used, rejected, arrows)


def _dots(uv: Array) -> str:
    return "".join(f"M{u:.1f} {v:.1f}h0" for u, v in uv)


def _read(path: Path, sha256: str | None) -> tuple[str, tuple[int, int]] | None:
    """A small JPEG of a picture as a data URI, and the picture's own (width, height).

    A report of a stranger may name any file: only what was in the calibration is shown.
    """
    import cv2

    from camcal.detect.decode import UnreadableError, decode_gray
    from camcal.detect.sources import read_bytes

    try:
        data = read_bytes(path)
        if hashlib.sha256(data).hexdigest() != sha256:
            raise ChangedError(path)
        gray = decode_gray(data)
    except UnreadableError:
        return None
    if gray.dtype != np.uint8:
        gray = (gray >> 8).astype(np.uint8)
    height, width = gray.shape
    small = cv2.resize(gray, (WIDTH, max(1, round(WIDTH * height / width))), interpolation=cv2.INTER_AREA)
    done, encoded = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    if not done:
        return None
    return "data:image/jpeg;base64," + base64.b64encode(encoded.tobytes()).decode("ascii"), (width, height)
