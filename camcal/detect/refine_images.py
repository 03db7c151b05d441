"""Read the pictures of a calibration again and sharpen their corners with its camera."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from camcal.data.observations import Observations, View
from camcal.detect.camera_pass import refine_with_camera
from camcal.detect.decode import UnreadableError
from camcal.detect.listing import view_ids
from camcal.detect.saddle import WIDER_HALF, wider_halves
from camcal.detect.sources import read_gray
from camcal.model.camera import Camera
from camcal.model.pose import Pose

Array = np.ndarray

#: called with (what happens, details) as the work goes on
OnEvent = Callable[[str, Mapping[str, Any]], None]


def refine_images(
    correspondences: Observations,
    camera: Camera,
    poses: Mapping[str, Pose],
    cell: float | None = None,
    on_event: OnEvent | None = None,
) -> tuple[Observations, float]:
    """Fit the corners of all pictures again; see `targets.camera_pass`.

    Parameters
    ----------
    correspondences : Observations
        As `detect_images` gives them, `files` included.
    camera : Camera
    poses : mapping of view id -> Pose
        cam_from_board; a view without one stays as it is.
    cell : float, optional
        Side of a square in that unit; that of the target where left out.
    on_event : callable, optional
        Called with `("refined", {id, moved_px})`, and with `("unrefined", {id, reason})` where a picture
        has gone or changed; its view stays as it is.

    Returns
    -------
    correspondences : Observations
    moved : float
        Root mean square of the moves over all corners, px.
    """
    target = correspondences.target or {}
    cell = float(cell if cell is not None else target.get("square", 1.0))
    paths = [Path(f["path"]) for f in correspondences.files]
    files = dict(zip(view_ids(paths), correspondences.files, strict=True))
    views, total, count = [], 0.0, 0
    for view in correspondences.views:
        pose = poses.get(view.id)
        if pose is None:
            views.append(view)
            continue
        try:
            gray = _read_again(files.get(view.id))
        except UnreadableError as error:
            views.append(view)
            if on_event is not None:
                on_event("unrefined", {"id": view.id, "reason": str(error)})
            continue
        from_pixel = partial(on_board, camera, pose)
        new, moved = refine_with_camera(gray, view, from_pixel, cell, _half(target, view))
        views.append(new)
        total, count = total + moved**2 * len(view), count + len(view)
        if on_event is not None:
            on_event("refined", {"id": view.id, "moved_px": moved})
    return correspondences.with_views(views), float(np.sqrt(total / max(count, 1)))


def on_board(camera: Camera, cam_from_board: Pose, pixels: Array) -> Array:
    """Where pixels (..., 2) lie on the plane z = 0 of a board, (..., 2) in its unit; NaN off the plane."""
    rays = camera.unproject(pixels) @ cam_from_board.rotation
    origin = -cam_from_board.rotation.T @ cam_from_board.translation
    with np.errstate(all="ignore"):
        reach = -origin[2] / rays[..., 2]
        place = origin[:2] + reach[..., None] * rays[..., :2]
    return np.where((reach > 0)[..., None], place, np.nan)


def _half(target: Mapping[str, Any], view: View) -> float | Array:
    """Half-widths of the windows, of a square: wider inside a checkerboard, where no edge is cut."""
    if target.get("kind") != "checkerboard" or view.point_ids is None:
        return WIDER_HALF
    return wider_halves(target["columns"], target["rows"])[view.point_ids]


def _read_again(file: Mapping[str, str] | None) -> Array:
    """The picture of a view.

    Raises
    ------
    UnreadableError
        Where it cannot be read, or is no longer what the corners came from.
    """
    if file is None:
        raise UnreadableError("no picture belongs to it")
    return read_gray(Path(file["path"]), file["sha256"])[0]
