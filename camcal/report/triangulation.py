"""The output of `camcal triangulate`."""

from __future__ import annotations

import csv
import io
import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from camcal.assess.covariance import covariance
from camcal.assess.rig import pose_rows
from camcal.data.labelled import Labelled, read_labelled
from camcal.errors import DataError
from camcal.peers.triangulate_points import against_cv2
from camcal.report.placed import load_placed
from camcal.report.rig_loading import from_document, is_rig_report
from camcal.report.routes import document, images_do_not_fit, uncertain_distance, warning
from camcal.report.yaml import read_document
from camcal.routes.calibration_part import calibration_part
from camcal.routes.distance import LINEAR
from camcal.routes.misfit import LARGE, misfit
from camcal.routes.placed import PlacedCamera
from camcal.routes.triangulate import Images, Triangulated, far_half_widths, sorted_images, triangulate
from camcal.system.text import cell

Array = np.ndarray

COLUMNS = ("point", *"XYZ", "sigma_X", "sigma_Y", "sigma_Z", "residual", "outliers")


def report(paths: Sequence[Path], points: Path, crosscheck: bool, command: Sequence[str]) -> dict[str, Any]:
    """Read cameras and image points, triangulate, and report the result.

    Raises
    ------
    DataError
        If a file cannot be read, a camera of the table is unknown, or no point has two images.
    """
    cameras = _cameras(paths)
    table = read_labelled(points, ("camera", "point"), optional=("sigma",))
    which = _matched(table, cameras, points)
    sigma = table.values.get("sigma")
    images, _ = sorted_images(which[table.labels["camera"]], table.labels["point"], table.uv, sigma)
    names = table.names["point"]
    found = triangulate(cameras, images, len(names))
    checks = _checks(found, images) if crosscheck else []
    part = _calibration(paths, found, images)
    sections = {
        "points": [
            _entry(i, name, found, images, part) for i, name in enumerate(names) if not found.reason[i]
        ],
        "undetermined": [{"point": n, "reason": r} for n, r in zip(names, found.reason, strict=True) if r],
        "sigma_hat": found.sigma_hat,
    }
    return document(command, None, sections, checks, _warnings(sections, found, images, names))


def csv_text(found: dict[str, Any]) -> str:
    """The points of a report as CSV, with all digits of every number."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(COLUMNS)
    for p in found["points"]:
        numbers = [repr(float(x)) for x in (*p["xyz"], *p["sigma"], p["residual"])]
        writer.writerow([cell(str(p["point"])), *numbers, cell(";".join(p["outliers"]))])
    return out.getvalue()


def _cameras(paths: Sequence[Path]) -> tuple[PlacedCamera, ...]:
    cameras = tuple(c for path in paths for c in load_placed(path))
    names = [c.name for c in cameras]
    if len(set(names)) < len(names):
        cameras = tuple(PlacedCamera(str(i + 1), c.camera, c.pose) for i, c in enumerate(cameras))
    if len(cameras) < 2:
        raise DataError("one camera is given; triangulation needs two or more.", "Give all of them.")
    return cameras


def _matched(table: Labelled, cameras: Sequence[PlacedCamera], path: Path) -> Array:
    """The camera that each name of the table refers to, (C,)."""
    known = {c.name: i for i, c in enumerate(cameras)}
    counted = {str(i + 1): i for i in range(len(cameras))}
    out = []
    for name in table.names["camera"]:
        index = known.get(name, counted.get(name))
        if index is None:
            raise DataError(
                f"{path}: there is no camera '{name}'; the cameras are {', '.join(known)}.",
                "Use these names in the table, or numbers from 1.",
            )
        out.append(index)
    return np.array(out)


def _calibration(paths: Sequence[Path], found: Triangulated, images: Images) -> Array | None:
    """The covariances (P, 3, 3) that the calibration of a rig adds; None for cameras whose report has none."""
    if len(paths) != 1 or paths[0].suffix.lower() not in (".yaml", ".yml", ".json"):
        return None
    document = read_document(paths[0])
    if not is_rig_report(document):
        return None
    rig = from_document(document, str(paths[0]))
    accuracy = covariance(rig)
    if not np.isfinite(accuracy.sigma_0):
        return None
    sizes = [camera.lens.size for camera in rig.cameras]
    begins = dict(zip(rig.rig.cameras, np.cumsum([0, *sizes]).tolist(), strict=False))
    moves = []
    for camera in found.cameras:
        begin = begins[camera.name]
        own = rig.free[begin : begin + camera.camera.lens.size]
        moves.append(np.concatenate([own, pose_rows(rig, camera.name)]))
    return calibration_part(found, images, moves, accuracy.free, accuracy.null)


def _entry(index: int, name: str, found: Triangulated, images: Images, part: Array | None) -> dict[str, Any]:
    rows = images.point == index
    left_out = images.camera[rows & ~found.used]
    own = found.covariance[index]
    total = own if part is None else own + part[index]
    more = {} if part is None else {"sigma_calibration": np.sqrt(np.diagonal(part[index]))}
    return {
        "point": name,
        "xyz": found.xyz[index],
        "sigma": np.sqrt(np.diagonal(total)),
        **more,
        "residual": found.residual[index],
        "images": int((rows & found.used).sum()),
        "outliers": [found.cameras[c].name for c in left_out],
        "covariance": total,
    }


def _checks(found: Triangulated, images: Images) -> list[dict[str, Any]]:
    """cv2 compared with camcal on the pair of cameras that shares the most points."""
    seen = [set(images.point[(images.camera == c) & found.used].tolist()) for c in range(len(found.cameras))]
    pairs = itertools.combinations(range(len(seen)), 2)
    a, b = max(pairs, key=lambda pair: len(seen[pair[0]] & seen[pair[1]]))
    shared = np.array(sorted(seen[a] & seen[b]), int)
    if not len(shared):
        return []
    rows = [np.flatnonzero((images.camera == c) & np.isin(images.point, shared)) for c in (a, b)]
    order = np.arange(len(shared))
    uv = np.concatenate([images.uv[r] for r in rows])
    two, _ = sorted_images(np.repeat([0, 1], len(shared)), np.r_[order, order], uv)
    pair = [found.cameras[a], found.cameras[b]]
    again = triangulate(pair, two, len(shared))
    sides = [(c.camera, c.pose, images.uv[r]) for c, r in zip(pair, rows, strict=True)]
    return [against_cv2(sides[0], sides[1], again.xyz)]


def _warnings(
    sections: dict[str, Any], found: Triangulated, images: Images, names: Sequence[str]
) -> list[dict[str, str]]:
    made = []
    lost = sections["undetermined"]
    if lost:
        first = lost[0]
        made.append(
            warning(
                "undetermined-points",
                f"{len(lost)} points are omitted, first '{first['point']}': {first['reason']}.",
                "A point needs two images whose rays intersect at an angle.",
                "note",
            )
        )
    wide = far_half_widths(found, images)
    if (wide > LINEAR).any():
        first = int(np.nanargmax(wide))
        made.append(
            uncertain_distance(
                f"{int((wide > LINEAR).sum())} of {int(found.known.sum())} points, worst '{names[first]}'",
                float(wide[first]),
                "One more camera, or a longer baseline.",
            )
        )
    rows = found.used & found.known[images.point]
    share = misfit(found.residuals[rows], images.uv[rows], images.camera[rows])
    if share > LARGE:
        made.append(images_do_not_fit(f"{int(found.known.sum())} points", share))
    outliers = int((~found.used).sum())
    if outliers:
        made.append(
            warning(
                "outlier-images",
                f"{outliers} images disagree with the others of their points.",
                "Check these images.",
                "note",
            )
        )
    return made
