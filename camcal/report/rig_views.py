"""`camcal evaluate` of a rig: read, placed, and what is left as a document."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from camcal.data.formats import files
from camcal.data.formats.base import CameraFile
from camcal.data.formats.camcal import rig_entry
from camcal.data.labelled import Labelled, read_labelled
from camcal.errors import DataError
from camcal.report.camera import camera_entry
from camcal.report.routes import document, pose_entry
from camcal.routes.placed import PlacedCamera
from camcal.routes.rig_views import RigPoints, RigView, place

Array = np.ndarray


def is_rig(path: str | os.PathLike) -> bool:
    """Whether a file holds several cameras with poses."""
    found = files.read(path)
    return len(found.cameras) > 1 and found.has_poses and not _one_camera(found)


def _one_camera(found: CameraFile) -> bool:
    """Whether the entries are pictures of one camera, as Pix4D lists them."""
    try:
        files.single(found, "")
    except DataError:
        return False
    return True


def evaluation(path: Path, table: Path, max_rms: float | None, command: Sequence[str]) -> dict[str, Any]:
    """Fit one pose to each view of a table of points, for all cameras of a rig together.

    Parameters
    ----------
    path : Path
        A rig in any format.
    table : Path
        With the columns camera, view, X, Y, Z, u, v and, where there are any, sigma.

    Raises
    ------
    DataError
        Where a camera of the table is not in the rig, or a view leaves its pose undetermined.
    """
    rig = files.read(path)
    cameras = [PlacedCamera(c.name, files.exact(c.camera), c.pose) for c in rig.cameras if c.pose is not None]
    points = read_labelled(table, ("camera", "view"), (*"XYZ", "u", "v"), ("sigma",))
    views = _views(points, rig.names, str(table))
    placed = [place(cameras, view) for view in views]
    residuals = np.concatenate([p.residuals for p in placed])
    fit = _figures(residuals)
    failed = max_rms is not None and fit["rms_point"] > max_rms
    failures = [f"rms_point {fit['rms_point']:.4g} exceeds {max_rms:g}"] if failed else []
    sections: dict[str, Any] = {
        "cameras": {c.name: camera_entry(c.camera, fixed=list(c.camera.lens.names)) for c in cameras},
        "rig": rig_entry(rig),
        "views": [_entry(v, p, rig.names) for v, p in zip(views, placed, strict=True)],
        "fit": fit,
    }
    return document(command, None, sections, failures=failures)


def _views(points: Labelled, names: Sequence[str], source: str) -> list[RigPoints]:
    unknown = [n for n in points.names["camera"] if n not in names]
    if unknown:
        raise DataError(f"{source}: the rig has no camera '{unknown[0]}'.", f"It has: {', '.join(names)}.")
    which = np.array([names.index(n) for n in points.names["camera"]])[points.labels["camera"]]
    xyz = np.stack([points.values[c] for c in "XYZ"], 1)
    roots = 1 / points.values["sigma"] if "sigma" in points.values else np.ones(len(points))
    made = []
    for i, name in enumerate(points.names["view"]):
        rows = points.labels["view"] == i
        made.append(RigPoints(name, which[rows], xyz[rows], points.uv[rows], roots[rows]))
    return made


def _figures(residuals: Array) -> dict[str, Any]:
    length = np.linalg.norm(residuals, axis=1)
    return {
        "rms_point": float(np.sqrt(np.mean(length**2))),
        "median": float(np.median(length)),
        "p95": float(np.quantile(length, 0.95)),
        "max": float(length.max()),
        "points_used": len(length),
        "points_rejected": 0,
    }


def _entry(points: RigPoints, placed: RigView, names: Sequence[str]) -> dict[str, Any]:
    by_camera = {}
    for i in np.unique(points.camera):
        mine = placed.residuals[points.camera == i]
        by_camera[names[i]] = {"points": len(mine), "rms_point": float(np.sqrt(np.mean((mine**2).sum(1))))}
    return {
        "id": points.id,
        "status": "used",
        "points": len(points.xyz),
        "rms_point": float(np.sqrt(np.mean((placed.residuals**2).sum(1)))),
        "rig_from_board": pose_entry(placed.pose),
        "cameras": by_camera,
    }


def tables(found: dict[str, Any]) -> Any:
    """The views and their cameras as a table."""
    from rich.console import Group
    from rich.table import Table

    made = Table("view", "camera", "points", "rms, px", box=None, pad_edge=False)
    for view in found["views"]:
        for name, figures in view["cameras"].items():
            made.add_row(view["id"], name, str(figures["points"]), f"{figures['rms_point']:.4g}")
    fit = found["fit"]
    said = (
        f"rms_point {fit['rms_point']:.4g} px over {fit['points_used']} points, at most {fit['max']:.4g} px"
    )
    return Group(made, said)
