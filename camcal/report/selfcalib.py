"""The report of `camcal selfcalib`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from camcal.data.labelled import Labelled, read_labelled
from camcal.data.writing import atomic_write
from camcal.errors import DataError, UsageError
from camcal.model import lenses
from camcal.model.pose import Pose
from camcal.peers import two_views
from camcal.report.camera import camera_entry
from camcal.report.routes import (
    bundle_entry,
    document,
    outside_picture,
    principal_point_assumed,
    warning,
)
from camcal.routes.bundle import Tracks
from camcal.routes.picture_tracks import of_pictures
from camcal.routes.read_lines import TABLES
from camcal.routes.selfcalib import SelfCalibration, estimate, kruppa_focal
from camcal.system.text import cell, counted, listed


def report(
    paths: Sequence[Path],
    model: str,
    fix: Mapping[str, float | None],
    image_size: tuple[int, int] | None,
    seed: int,
    crosscheck: bool,
    command: Sequence[str],
    save_tracks: Path | None = None,
    force: bool = False,
    said: Callable[[str], None] | None = None,
) -> dict[str, Any]:
    """Calibrate from a table of tracks, or from pictures."""
    if len(paths) == 1 and Path(paths[0]).suffix.lower() in TABLES:
        if image_size is None:
            raise UsageError("the size of the pictures is not given.", "Give --image-size WxH.")
        table = read_labelled(paths[0], ("view", "point"))
        tracks, twice = _tracks(table)
        views, count = list(table.names["view"]), len(table.names["point"])
    else:
        tracks, views, count, size = of_pictures(paths, seed, said)
        if image_size not in (None, size):
            raise DataError(f"the pictures are {size[0]}x{size[1]} px.", "Leave out --image-size.")
        twice, image_size = 0, size
    if save_tracks is not None:
        atomic_write(save_tracks, _csv(tracks, views), force)
    found = estimate(tracks, len(views), count, lenses.make(model), image_size, fix, seed)
    camera = found.bundle.camera
    sigmas = dict(zip(camera.lens.names, np.sqrt(np.diagonal(found.covariance)).tolist(), strict=True))
    entry = camera_entry(camera, sigmas, found.start.values, found.fixed)
    residuals = found.bundle.residuals(tracks)
    sections = {
        "views": [_view(i, name, found, tracks, residuals) for i, name in enumerate(views)],
        "fit": bundle_entry(found.iterations, found.converged, residuals, found.used),
        "selfcalib": {
            "focal_length_from_pairs": float(found.start.params[0]),
            "focal_length_kruppa": kruppa_focal(found),
            "focal_length_dual_quadric": found.dual_quadric,
            "focal_length_interval": found.interval
            and [float(f) if np.isfinite(f) else None for f in found.interval],
            "rays_from_pairs": found.rays,
            "pairs": len(found.pairs),
            "views": int(found.bundle.known_views.sum()),
            "points": int(np.count_nonzero(np.bincount(tracks.point[found.used]))),
        },
    }
    checks = _checks(found, tracks) if crosscheck else []
    warnings = [*outside_picture(tracks.uv[found.used], image_size), *_warnings(found, views, twice)]
    return document(command, entry, sections, checks, warnings)


def _csv(tracks: Tracks, views: Sequence[str]) -> str:
    """Read the table of tracks."""
    rows = zip(tracks.view.tolist(), tracks.point.tolist(), tracks.uv.tolist(), strict=True)
    return "view,point,u,v\n" + "".join(f"{cell(views[v])},{p},{u:.3f},{w:.3f}\n" for v, p, (u, w) in rows)


def _tracks(table: Labelled) -> tuple[Tracks, int]:
    """The tracks, each point once per view, and the number of duplicate images removed."""
    key = table.labels["view"].astype(np.int64) * len(table.names["point"]) + table.labels["point"]
    first = np.sort(np.unique(key, return_index=True)[1])
    if len(table.names["view"]) < 2:
        raise DataError(
            f"'{table.path}' holds one view; two or more are needed.", "Give tracks over several views."
        )
    tracks = Tracks(table.labels["view"][first], table.labels["point"][first], table.uv[first])
    return tracks, len(table) - len(first)


def _view(
    index: int, name: str, found: SelfCalibration, tracks: Tracks, residuals: np.ndarray
) -> dict[str, Any]:
    rows = tracks.view == index
    used = rows & found.used
    known = bool(found.bundle.known_views[index]) and bool(used.any())
    entry: dict[str, Any] = {
        "id": name,
        "status": "used" if known else "rejected",
        "reason": None if known else "too few of its points are determined by other views",
        "points": int(rows.sum()),
        "rejected_points": int((rows & ~found.used).sum()),
        "rms_point": float(np.sqrt(np.square(residuals[used]).sum(1).mean())) if known else None,
        "cam_from_world": None,
    }
    if known:
        entry["cam_from_world"] = Pose(
            found.bundle.rotations[index], found.bundle.translations[index]
        ).entry()
    return entry


def _checks(found: SelfCalibration, tracks: Tracks) -> list[dict[str, Any]]:
    pair = found.pairs[0]
    rows = pair.matches[pair.agree]
    first, second = (found.pixels[rows[:, i]] for i in (0, 1))
    checks = [two_views.fundamental(first, second, pair.matrix)]
    first, second = (tracks.uv[rows[:, i]] for i in (0, 1))
    b = found.bundle
    if b.known_views[pair.first] and b.known_views[pair.second]:
        poses = [Pose(b.rotations[v], b.translations[v]) for v in (pair.second, pair.first)]
        checks.append(two_views.motion(b.camera, first, second, poses[0] @ poses[1].inverse()))
    return checks


def _warnings(found: SelfCalibration, views: Sequence[str], twice: int) -> list[dict[str, str]]:
    made = []
    if found.assumed:
        made.append(
            principal_point_assumed(
                "the views leave",
                found.assumed,
                "Take views with the camera rolled by 90 degrees, or give it (--fix cx=VALUE,cy=VALUE).",
            )
        )
    lost = [n for n, known in zip(views, found.bundle.known_views, strict=True) if not known]
    if lost:
        made.append(
            warning(
                "views-left-out",
                f"{counted(len(lost), 'view')} could not be added: {listed(lost)}.",
                "Add tracks.",
                "note",
            )
        )
    if twice:
        made.append(
            warning(
                "points-twice",
                f"{twice} images are of a point that the view already has.",
                "The first of them is used.",
                "note",
            )
        )
    return made
