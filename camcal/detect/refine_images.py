"""A second pass over the pictures of a calibration, which refines the corners using its camera."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from camcal.data.observations import Observations, View
from camcal.detect import cache
from camcal.detect.camera_pass import refine_in_windows
from camcal.detect.decode import UnreadableError
from camcal.detect.listing import view_ids
from camcal.detect.part import KEPT_PARTS, OutsideError, Picture
from camcal.detect.saddle import INNER_HALF, WIDER_HALF, wider_halves
from camcal.detect.sources import read_gray
from camcal.detect.workers import Workers
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from camcal.system.processes import one_opencv_thread
from camcal.version import __version__

Array = np.ndarray

#: called with (event, details) as the work proceeds
OnEvent = Callable[[str, Mapping[str, Any]], None]
#: side of a square, blur (px) of the picture, whether black and white are exchanged, half-widths of windows (squares)
How = tuple[float, float | None, bool, list[float | Array]]
#: points (N, 2), px, and their standard deviations (N,)
Measured = tuple[Array, Array | None]


class _Task(NamedTuple):
    """A view whose corners are to be fitted again."""

    file: Mapping[str, str] | None
    view: View
    camera: Camera
    pose: Pose
    how: How
    cache: Path | None


def refine_images(
    found: Observations,
    camera: Camera,
    poses: Mapping[str, Pose],
    cell: float | None = None,
    on_event: OnEvent | None = None,
    windows: Sequence[float] = (INNER_HALF,),
) -> list[Observations]:
    """Fit the corners of all pictures again, reading each picture once more; see `camera_pass`.

    Parameters
    ----------
    found : Observations
        From `detect_images`, including `files`.
    camera : Camera
    poses : mapping of view id -> Pose
        cam_from_board; a view without one remains unchanged.
    cell : float, optional
        Side of a square in the unit of the board; by default that of the target.
    on_event : callable, optional
        Called with `("refined", {id, moved_px})`, and with `("unrefined", {id, reason})` if a picture
        is missing or has changed; its view remains unchanged.
    windows : sequence of float
        Half-widths of the windows, in squares, ascending, such as `camera_pass.WINDOWS`.

    Returns
    -------
    list of Observations
        One for each of `windows`.
    """
    target = found.target or {}
    cell = float(cell if cell is not None else target.get("square", 1.0))
    files = dict(zip(view_ids([Path(f["path"]) for f in found.files]), found.files, strict=True))
    posed = [i for i, view in enumerate(found.views) if view.id in poses]
    tasks = (
        _Task(files.get(v.id), v, camera, poses[v.id], _how(found, v, cell, windows), cache.in_use())
        for v in (found.views[i] for i in posed)
    )
    tell = on_event or (lambda *_: None)
    versions = [[view] * len(windows) for view in found.views]
    with one_opencv_thread(), Workers(KEPT_PARTS.jobs) as workers:
        for index, new in workers.map_unordered(_refined, tasks, _crashed, len(posed)):
            view = found.views[posed[index]]
            if isinstance(new, str):
                tell("unrefined", {"id": view.id, "reason": new})
                continue
            versions[posed[index]] = [replace(view, uv=uv, sigma=sigma) for uv, sigma in new]
            tell("refined", {"id": view.id, "moved_px": rms_move(view.uv, new[0][0])})
    return [found.with_views(views) for views in zip(*versions, strict=True)]


def _how(found: Observations, view: View, cell: float, windows: Sequence[float]) -> How:
    target = found.target or {}
    blur = found.picture_quality.get(view.id, {}).get("blur_px")
    return cell, blur, bool(target.get("negative")), [_half(target, view, w) for w in windows]


def _refined(task: _Task) -> list[Measured] | str:
    """The corners of a view fitted again, once for each window, from the cache if they are there; or why not."""
    place = _place(task)
    known = None if place is None else _from_cache(place, task.view, len(task.how[-1]))
    if known is not None:
        return known
    try:
        new = [(v.uv, v.sigma) for v in _fitted(task)]
    except UnreadableError as error:
        return str(error)
    if place is not None:
        _into_cache(place, new)
    return new


def _fitted(task: _Task) -> list[View]:
    """The view with its corners fitted again, once for each window: in the part that was kept, where that suffices.

    Raises
    ------
    UnreadableError
        See `_read_again`.
    """
    cell, blur, negative, halves = task.how

    def fitted(picture: Picture) -> list[View]:
        board_from_pixel = partial(on_board, task.camera, task.pose)
        return refine_in_windows(picture, task.view, board_from_pixel, cell, halves, blur)

    # a part may have been kept while the picture was searched as it is: none is used of a negative
    part = None if task.file is None or negative else KEPT_PARTS.get(task.file["sha256"])
    if part is not None:
        with suppress(OutsideError):
            return fitted(part)
    return fitted(_read_again(task))


def _crashed(task: _Task) -> str:
    return "the process that refined it ended unexpectedly"


def rms_move(before: Array, after: Array) -> float:
    """The rms distance between points (N, 2), px; 0 if there are none."""
    return float(np.sqrt(np.square(after - before).sum(1).mean())) if len(before) else 0.0


def on_board(camera: Camera, cam_from_board: Pose, pixels: Array) -> Array:
    """The intersections of the rays of pixels (..., 2) with the plane z = 0 of a board, (..., 2) in its unit; NaN
    without an intersection.
    """
    rays = camera.unproject(pixels) @ cam_from_board.rotation
    origin = cam_from_board.centre
    with np.errstate(all="ignore"):
        reach = -origin[2] / rays[..., 2]
        place = origin[:2] + reach[..., None] * rays[..., :2]
    return np.where((reach > 0)[..., None], place, np.nan)


def _place(task: _Task) -> Path | None:
    """The cache entry of a view's second pass; None without a cache."""
    if task.cache is None or task.file is None:
        return None
    view, camera, pose = task.view, task.camera, task.pose
    digest = hashlib.sha256()
    sigma = np.zeros(0) if view.sigma is None else view.sigma
    for values in (view.uv, sigma, camera.params, pose.rotation, pose.translation, *task.how[-1]):
        digest.update(np.ascontiguousarray(values, float).tobytes())
    words = (
        f"{__version__} {cache.code()} {camera.lens.name} {camera.image_size} {len(sigma)} {task.how[:-1]}"
    )
    return cache.entry(task.cache, task.file["sha256"], f"second pass {words} {digest.hexdigest()}")


def _into_cache(place: Path, new: Sequence[Measured]) -> None:
    """Keep a view's second pass: points (W, N, 2) and sigmas (W, N), or none."""
    arrays, sigmas = {"uv": np.stack([uv for uv, _ in new])}, [s for _, s in new if s is not None]
    if sigmas:
        arrays["sigma"] = np.stack(sigmas)
    if len(sigmas) in (0, len(new)):
        cache.store(place, arrays, {})


def _from_cache(place: Path, view: View, count: int) -> list[Measured] | None:
    """The points of a cached second pass, for each window size; None if there is none."""
    stored = cache.load(place)
    if stored is None:
        return None
    uv, sigma = stored[0].get("uv"), stored[0].get("sigma")
    shape = (count, *view.uv.shape)
    if uv is None or uv.shape != shape or (sigma is not None and sigma.shape != shape[:2]):
        return None
    if sigma is None:
        return [(u, None) for u in uv] if view.sigma is None else None
    return list(zip(uv, sigma, strict=True))


def _half(target: Mapping[str, Any], view: View, window: float) -> float | Array:
    """Half-widths of the windows, in squares; smaller at the border of a checkerboard, whose squares may be cut."""
    if target.get("kind") != "checkerboard" or view.point_ids is None:
        return min(window, WIDER_HALF)
    return wider_halves(target["columns"], target["rows"], window)[view.point_ids]


def _read_again(task: _Task) -> Array:
    """The picture of a view, with black and white exchanged if its corners come from a negative.

    Raises
    ------
    UnreadableError
        If it cannot be read, or has changed since the corners were found.
    """
    if task.file is None:
        raise UnreadableError("its picture is not known")
    gray = read_gray(Path(task.file["path"]), task.file["sha256"])[0]
    return ~gray if task.how[2] else gray
