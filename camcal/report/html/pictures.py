"""Thumbnails of the pictures with their corners and residuals, if the files still exist."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from camcal.model.camera import Camera
from camcal.plan.solution import Solution
from camcal.records import dataclass
from camcal.report.charts.residuals import enlargement
from camcal.system.reading import is_file
from camcal.system.text import counted, listed

Array = np.ndarray

WIDTH = 340
#: of the preview without distortion, and of its quality
PREVIEW_WIDTH, PREVIEW_QUALITY = 640, 75
QUALITY = 62
#: more thumbnails than this are not shown: the worst views, and some of those that were not used
MOST_USED, MOST_OTHERS = 24, 8
MOST_NAMED = 6  #: pictures that have changed


@dataclass(frozen=True)
class Thumbnail:
    """A picture as a data URI, and the overlay in the picture's own pixels."""

    id: str
    caption: str
    uri: str
    size: tuple[int, int]
    used: str  #: SVG path of dots
    rejected: str
    arrows: str


def thumbnails(solution: Solution, report: dict[str, Any], folder: Path) -> tuple[list[Thumbnail], str]:
    """The available thumbnails, and a sentence about the missing ones.

    Parameters
    ----------
    solution : Solution
    report : dict
        Its document: `inputs.files` say where the pictures were.
    folder : Path
        That of the report, relative to which paths are tried that do not exist from the current folder.
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
        names = listed(changed, MOST_NAMED)
        said += f" Not shown, as their files have changed since the calibration: {names}."
    if missing:
        said += f" Without {counted(missing, 'picture')}: the worst come first, and files that are gone are omitted."
    return made, said


class ChangedError(Exception):
    """A file is not the picture of the calibration: its SHA-256 differs or is unknown."""


def _paths(report: dict[str, Any], folder: Path) -> dict[str, tuple[Path, str | None]]:
    """The path of each view's picture and its original SHA-256, by the view's id."""
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
    """`b/c.jpg`, `a/b/c.jpg`, ...: ids of views that have the same file name."""
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


@dataclass(frozen=True)
class Preview:
    """A picture as taken and without distortion, as data URIs."""

    id: str
    before: str
    after: str


def preview(solution: Solution, report: dict[str, Any], folder: Path) -> Preview | None:
    """The used picture whose points reach farthest from the principal point; None if all files are missing."""
    paths, data, centre = _paths(report, folder), solution.observations, solution.camera.params[2:4]
    reach = {
        v.id: float(np.linalg.norm(v.uv - centre, axis=1).max(initial=0.0))
        for v in data.views
        if v.id in paths
    }
    for name in sorted(reach, key=lambda n: -reach[n]):
        try:
            gray = _gray(*paths[name])
        except ChangedError:
            continue
        if gray is not None and solution.camera.image_size == gray.shape[::-1]:
            before, after = (_uri(p, PREVIEW_QUALITY) for p in _undistorted(solution.camera, gray))
            return None if before is None or after is None else Preview(name, before, after)
    return None


def _undistorted(camera: Camera, gray: Array) -> tuple[Array, Array]:
    """A reduced picture, and the same without distortion."""
    import cv2

    height, width = gray.shape
    factor = min(1.0, PREVIEW_WIDTH / width)
    size = round(width * factor), round(height * factor)
    small = cv2.resize(gray, size, interpolation=cv2.INTER_AREA)
    u, v = np.meshgrid(*((np.arange(n) + 0.5) / factor - 0.5 for n in size))
    pinhole = np.stack([u, v, np.ones_like(u)], -1) @ np.linalg.inv(camera.matrix).T
    seen = (camera.project(pinhole.reshape(-1, 3)).reshape(*u.shape, 2) + 0.5) * factor - 0.5
    # pixels that no ray reaches become black
    seen = np.nan_to_num(seen, nan=-1e4).astype(np.float32)
    return small, cv2.remap(small, seen[..., 0], seen[..., 1], cv2.INTER_LINEAR)


def _read(path: Path, sha256: str | None) -> tuple[str, tuple[int, int]] | None:
    """A small JPEG of a picture as a data URI, and the picture's own (width, height)."""
    import cv2

    gray = _gray(path, sha256)
    if gray is None:
        return None
    height, width = gray.shape
    small = cv2.resize(gray, (WIDTH, max(1, round(WIDTH * height / width))), interpolation=cv2.INTER_AREA)
    uri = _uri(small, QUALITY)
    return None if uri is None else (uri, (width, height))


def _gray(path: Path, sha256: str | None) -> Array | None:
    """A picture, 8 bits; None if it cannot be read.

    A report from an untrusted source may name any file: only pictures of the calibration are shown.

    Raises
    ------
    ChangedError
        If it is no longer the picture of the calibration.
    """
    from camcal.detect.decode import UnreadableError, decode_gray
    from camcal.detect.sources import read_bytes

    try:
        data = read_bytes(path)
        if hashlib.sha256(data).hexdigest() != sha256:
            raise ChangedError(path)
        gray = decode_gray(data)
    except UnreadableError:
        return None
    return gray if gray.dtype == np.uint8 else (gray >> 8).astype(np.uint8)


def _uri(picture: Array, quality: int) -> str | None:
    import cv2

    done, encoded = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return "data:image/jpeg;base64," + base64.b64encode(encoded.tobytes()).decode("ascii") if done else None
