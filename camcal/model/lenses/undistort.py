"""The resampling map of an undistorted picture, for every lens model."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from camcal.errors import EstimationError, UsageError
from camcal.geometry.picture import in_picture
from camcal.model.camera import Camera
from camcal.model.lenses import make
from camcal.records import dataclass

Array = np.ndarray

#: pixels of a new picture, as many as a picture that is read may have; its map takes 8 bytes a pixel
MOST_PIXELS = 200_000_000
#: pixels that are mapped at a time: some 60 bytes each
STRIP = 1 << 20

#: output projections: what they are called -> the lens without distortion that makes them
PROJECTIONS = {"perspective": "pinhole", "equidistant": "kb:0"}
#: half-angle, rad, that a projection is let reach: a plane cannot hold 90 degrees, and at 80 a pixel at the rim
#: is 33 times as long as in the middle
WIDEST = {"perspective": np.deg2rad(80), "equidistant": np.deg2rad(179)}
#: points along each side of a picture, and across it, that stand for all: between two on a side of 4000 px a border
#: bends by hundredths of a px
SIDE, INSIDE = 101, 31
#: of the widest half-angle: where the search for the smallest focal length begins, just inside the limit
BELOW_WIDEST = 0.999
#: factor of a step of that search; the bisection that follows needs few steps more than after a smaller one
GROWTH = 1.5
#: in picture sizes: a picture that is not filled at this focal length, whose angle is a millionth of a rad, never is
LONGEST_FOCAL = 1e6
#: relative: a focal length found to this moves a pixel at the border of 4000 px by .02 px
BISECTED = 1e-5


@dataclass(frozen=True)
class Undistortion:
    """A map from the pixels of the new picture to those of the old one.

    Attributes
    ----------
    camera : Camera
        Of the new picture: without distortion.
    u, v : (height, width) float32 arrays
        Where in the old picture each pixel lies; -1 where nowhere.
    black : float
        Part of the new picture that shows nothing of the old one.
    """

    camera: Camera
    u: Array
    v: Array
    black: float


def undistortion(
    camera: Camera,
    keep: str | float = "all",
    size: tuple[int, int] | None = None,
    projection: str = "perspective",
) -> Undistortion:
    """Lay out an undistorted picture.

    Parameters
    ----------
    camera : Camera
        With its image size.
    keep : `all`, `no-black`, or an angle
        All pixels of the old picture (within `WIDEST`); the largest field without black; or the horizontal
        field of view, rad.
    size : (width, height), optional
        Of the new picture; that of the old one by default.
    projection : str
        One of `PROJECTIONS`.

    Raises
    ------
    UsageError
        If the camera does not know its image size, or a field is too wide for the projection.
    EstimationError
        If the middle of the picture has no ray.
    """
    if camera.image_size is None:
        raise UsageError("the camera file has no image size.", "Give --image-size WxH.")
    new = size or camera.image_size
    if new[0] * new[1] > MOST_PIXELS:
        raise UsageError(
            f"a picture of {new[0]}x{new[1]} pixels is too large; at most {MOST_PIXELS // 10**6} million "
            f"are allowed.",
            "Give a smaller --size.",
        )
    if isinstance(keep, str):
        target = (_all_pixels if keep == "all" else _no_black)(camera, new, projection)
    else:
        target = _given_field(keep, new, projection)
    width, height = new
    u, v = np.empty((2, height, width), np.float32)
    shown = 0
    step = max(1, STRIP // width)
    for top in range(0, height, step):
        rows = np.arange(top, min(top + step, height), dtype=float)
        pixels = np.stack(np.meshgrid(np.arange(width, dtype=float), rows), -1)
        seen, inside = _sources(camera, target, pixels)
        seen[~inside] = -1
        u[top : top + step], v[top : top + step] = seen[..., 0], seen[..., 1]
        shown += int(inside.sum())
    return Undistortion(target, u, v, 1 - shown / (width * height))


def _sources(camera: Camera, target: Camera, pixels: Array) -> tuple[Array, Array]:
    """The source pixels of pixels (..., 2) of the new picture, and which of them exist."""
    assert camera.image_size is not None
    seen = camera.project(target.unproject(pixels))
    return seen, in_picture(seen, camera.image_size)


def _camera(projection: str, f: float, size: tuple[int, int], centre: Array | None = None) -> Camera:
    lens = make(PROJECTIONS[projection])
    cx, cy = (np.array(size) - 1) / 2 if centre is None else centre
    values = {"fx": f, "fy": f, "cx": float(cx), "cy": float(cy)}
    return Camera(lens, lens.from_values(values), size)


def _given_field(field: float, size: tuple[int, int], projection: str) -> Camera:
    half = field / 2
    if not 0 < half <= WIDEST[projection]:
        raise UsageError(
            f"a {projection} picture cannot show {np.degrees(field):g} degrees; "
            f"at most {2 * np.degrees(WIDEST[projection]):g}.",
            "Try: --projection equidistant" if projection == "perspective" else "Try: --keep 180deg",
        )
    edge = np.array([np.sin(half), 0.0, np.cos(half)])
    reach = float(_camera(projection, 1.0, size, np.zeros(2)).project(edge)[0])
    return _camera(projection, (size[0] - 1) / 2 / reach, size)


def _all_pixels(camera: Camera, size: tuple[int, int], projection: str) -> Camera:
    """The largest focal length at which the new picture contains every pixel of the old one; square pixels."""
    rays = camera.unproject(border_grid(camera.image_size or size))
    rays = rays[np.isfinite(rays).all(1)]
    rays = rays[np.arccos(np.clip(rays[:, 2], -1, 1)) <= WIDEST[projection]]
    if not len(rays):
        raise EstimationError("no pixel of the picture has a ray.", "Check the camera's file.")
    m = _camera(projection, 1.0, size, np.zeros(2)).project(rays)
    low, high = m.min(0), m.max(0)
    f = float(((np.array(size) - 1) / (high - low)).min())
    return _camera(projection, f, size, (np.array(size) - 1) / 2 - f * (low + high) / 2)


def _no_black(camera: Camera, size: tuple[int, int], projection: str) -> Camera:
    """The smallest focal length at which every pixel of the new picture lies in the old one."""
    grid = border_grid(size, size[0], size[1])

    def covered(f: float) -> bool:
        return bool(_sources(camera, _camera(projection, f, size), grid)[1].all())

    low = _given_field(2 * WIDEST[projection] * BELOW_WIDEST, size, projection).params[0]
    high = low
    while not covered(high):
        high *= GROWTH
        if high > LONGEST_FOCAL * max(size):
            raise EstimationError("the middle of the picture has no ray.", "Check the camera's file.")
    return _camera(projection, bisected(covered, low, high), size)


def bisected(holds: Callable[[float], bool], low: float, high: float) -> float:
    """The smallest value, to `BISECTED`, at which `holds` is true; it must be true at `high`."""
    while high > low * (1 + BISECTED):
        middle = np.sqrt(low * high)
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high


def border_grid(size: tuple[int, int], along: int = SIDE, down: int = SIDE) -> Array:
    """Pixels (N, 2) along the sides of a picture, `along` and `down` of them, and a coarser grid inside it."""
    w, h = size[0] - 1.0, size[1] - 1.0
    a, b = np.linspace(0, w, along), np.linspace(0, h, down)
    u, v = np.meshgrid(np.linspace(0, w, INSIDE), np.linspace(0, h, INSIDE))
    sides = np.c_[a, 0 * a], np.c_[a, 0 * a + h], np.c_[0 * b, b], np.c_[0 * b + w, b]
    return np.concatenate([*sides, np.c_[u.ravel(), v.ravel()]])
