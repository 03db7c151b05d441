"""Rectification of two cameras: both pictures are rotated and resampled so that a point lies in the same row of both.

The cameras are first given the same orientation, each turned by half of the rotation between them; both are then
turned by the smallest rotation that puts the baseline on the x axis (a horizontal pair) or on the y axis (a vertical
one). That is the rotation of A. Fusiello, E. Trucco & A. Verri, A compact algorithm for rectification of stereo pairs
(2000), with the mean orientation of both cameras in place of that of the first; cv2.stereoRectify chooses it too.

The rectified picture of either camera is, with (x, y, z) in its rectified frame and the baseline along x,

    perspective:         u = f x / z + cx,              v = f y / z + cy                                  (1)
    latitude-longitude:  u = f asin(x / r) + cx,        v = f atan2(y, z) + cy,     r = |(x, y, z)|       (2)

In (2) a row is a half-plane through the baseline, so that fields beyond 180 degrees have rows too. Of a vertical pair
the two coordinates change places.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from camcal.errors import EstimationError, UsageError
from camcal.geometry import projective, rotations
from camcal.geometry.picture import in_picture
from camcal.model.camera import Camera
from camcal.model.lenses.undistort import GROWTH, bisected, border_grid
from camcal.model.pose import Pose
from camcal.records import dataclass

Array = np.ndarray

PERSPECTIVE, LATITUDE_LONGITUDE = "perspective", "latitude-longitude"
#: half-angle, rad, up to which `auto` takes a perspective picture: there a pixel at the rim is 1 / cos² = 4 times as
#: long as in the middle, and at 70 degrees 9 times
WIDE = np.deg2rad(60)
#: of the smallest scale: pictures without black that show a thousandth of the field and less share nothing
MOST_ENLARGED = 1e3
#: half-angle, rad, that is shown at most: a plane cannot hold 90 degrees; near the baseline, which both kinds approach
#: there, rows come together and disparities say nothing of the distance
WIDEST = {PERSPECTIVE: np.deg2rad(80), LATITUDE_LONGITUDE: np.deg2rad(85)}


@dataclass(frozen=True, eq=False, repr=False)
class Rectification:
    """The rectified pictures of two cameras, with the same scale, centre and size.

    Attributes
    ----------
    cameras : (Camera, Camera)
    turns : (2, 3, 3) array
        R1 and R2: rectified_from_cam of each.
    shift : float
        Of the second camera's frame from the first one's along the baseline, in the unit of the poses: negative where
        the second one is on the right of, or below, the first; disparities (first less second) are then positive.
    axis : int
        0 of a horizontal pair, 1 of a vertical one.
    projection : str
        `PERSPECTIVE` or `LATITUDE_LONGITUDE`.
    focal : float
        px, or px per rad.
    centre : (2,) array
        (cx, cy), px: of both pictures, so that points at infinity have the disparity 0.
    image_size : (width, height)
    """

    cameras: tuple[Camera, Camera]
    turns: Array
    shift: float
    axis: int
    projection: str
    focal: float
    centre: Array
    image_size: tuple[int, int]

    def __repr__(self) -> str:
        """Return one line: the kind of pair, projection, scale and size."""
        kind, (width, height) = ("horizontal", "vertical")[self.axis], self.image_size
        unit = "px" if self.projection == PERSPECTIVE else "px per rad"
        return f"<Rectification {kind}, {self.projection}, {self.focal:.5g} {unit}, {width}x{height}>"

    def pixels(self, rays: Array) -> Array:
        """Rectified pixels (..., 2) of directions (..., 3) of the rectified frame; NaN beyond `WIDEST`."""
        return self.focal * _flat(rays, self.projection, self.axis) + self.centre

    def rays(self, pixels: Array) -> Array:
        """Directions (..., 3) of unit length, in the rectified frame, of rectified pixels (..., 2)."""
        return _unflat((np.asarray(pixels, float) - self.centre) / self.focal, self.projection, self.axis)

    def rectified(self, side: int, uv: Array) -> Array:
        """Rectified pixels of pixels (..., 2) of the first (0) or second (1) camera; NaN where there is none."""
        return self.pixels(self.cameras[side].unproject(np.asarray(uv, float)) @ self.turns[side].T)

    def disparities(self, first: Array, second: Array) -> tuple[Array, Array]:
        """Differences along the baseline and across it (...), px, for pixels (..., 2) of both pictures that show
        the same points.

        The one across it, "vertical disparity", is 0 where the calibration is right.
        """
        difference = self.rectified(0, first) - self.rectified(1, second)
        return difference[..., self.axis], difference[..., 1 - self.axis]

    def maps(self, side: int) -> tuple[Array, Array]:
        """The source of each rectified pixel in the picture as taken: u, v (height, width) float32; -1 where there
        is none.
        """
        width, height = self.image_size
        u, v = np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float))
        rays = self.rays(np.stack([u, v], -1))
        seen, inside = _sources(self.cameras[side], self.turns[side], rays)
        seen[~inside] = -1
        return seen[..., 0].astype(np.float32), seen[..., 1].astype(np.float32)

    def matrices(self) -> dict[str, Array]:
        """R1, R2 (3, 3), P1, P2 (3, 4) and Q (4, 4) as named by cv2.stereoRectify; for (2), only R1 and R2.

        Q takes (u, v, disparity, 1) to homogeneous coordinates in the rectified frame of the first camera.
        """
        made = {"R1": self.turns[0], "R2": self.turns[1]}
        if self.projection != PERSPECTIVE:
            return made
        cx, cy = self.centre
        p1 = np.array([[self.focal, 0, cx, 0], [0, self.focal, cy, 0], [0, 0, 1.0, 0]])
        p2 = p1.copy()
        p2[self.axis, 3] = self.focal * self.shift
        q = np.array([[1, 0, 0, -cx], [0, 1, 0, -cy], [0, 0, 0, self.focal], [0, 0, -1 / self.shift, 0]])
        return made | {"P1": p1, "P2": p2, "Q": q}


def aligned(second_from_first: Pose) -> tuple[Array, float, int]:
    """R1 and R2 (2, 3, 3), the shift along the baseline, and its axis (0 or 1); see `Rectification`.

    Raises
    ------
    EstimationError
        If both cameras stand at the same place.
    """
    half = rotations.exp(-rotations.log(second_from_first.rotation) / 2)
    between = half @ second_from_first.translation
    length = float(np.linalg.norm(between))
    if length == 0:
        raise EstimationError(
            "the two cameras are at the same position: there is no baseline to rectify along.",
            "Check the translations in the file of the rig.",
        )
    axis = int(abs(between[1]) > abs(between[0]))
    target = np.zeros(3)
    target[axis] = 1.0 if between[axis] >= 0 else -1.0
    across = np.cross(between / length, target)
    sine, cosine = float(np.linalg.norm(across)), float(between @ target) / length
    turn = rotations.exp(across * (np.arctan2(sine, cosine) / sine if sine else 0.0))
    return np.stack([turn @ half.T, turn @ half]), length * float(target[axis]), axis


def rectify(
    first: Camera,
    second: Camera,
    second_from_first: Pose,
    alpha: float | None = None,
    size: tuple[int, int] | None = None,
    projection: str = "auto",
) -> Rectification:
    """Lay out the rectified pictures of two cameras.

    Parameters
    ----------
    first, second : Camera
        With their image sizes.
    alpha : float, optional
        0: the largest field in which neither picture is black anywhere; 1: all pixels of both; between: in
        proportion. None: the scale in the middle of the pictures is kept (the smaller one of the two).
    size : (width, height), optional
        Of the rectified pictures; that of the first camera's by default.
    projection : str
        `PERSPECTIVE`, `LATITUDE_LONGITUDE`, or `auto`: the latter where a picture reaches beyond `WIDE`.

    Returns
    -------
    Rectification

    Raises
    ------
    UsageError
        If a camera does not know its image size.
    EstimationError
        If the cameras stand at the same place, a picture shows the other camera's place (a perspective picture
        then has no rows), or nothing is left that both show.
    """
    for camera in (first, second):
        if camera.image_size is None:
            raise UsageError("the rig file has no image size.", "Write image_size into it.")
    assert first.image_size is not None
    cameras, new = (first, second), size or first.image_size
    turns, shift, axis = aligned(second_from_first)
    borders = [_border(c, t) for c, t in zip(cameras, turns, strict=True)]
    projection = _projection_for(borders) if projection == "auto" else projection
    if projection == PERSPECTIVE:
        _refuse_epipoles(cameras, turns, axis)
    unit = Rectification(cameras, turns, shift, axis, projection, 1.0, np.zeros(2), new)
    made = _scaled(unit, [unit.pixels(b) for b in borders], alpha)
    rays = made.rays(border_grid(new))
    if not np.all([_sources(c, t, rays)[1] for c, t in zip(cameras, turns, strict=True)], 0).any():
        raise _nothing_shared()
    return made


def _scaled(unit: Rectification, borders: Sequence[Array], alpha: float | None) -> Rectification:
    """The layout with the scale and centre that `alpha` asks for.

    Parameters
    ----------
    unit : Rectification
        With the scale 1 and the centre (0, 0).
    borders : two (N, 2) arrays
        Pixels of `unit` along the sides of both pictures; NaN outside.
    """
    borders = [b[np.isfinite(b).all(1)] for b in borders]
    if not all(len(b) for b in borders):
        raise _nothing_shared()
    middle = np.mean([b.mean(0) for b in borders], 0)
    half = (np.array(unit.image_size) - 1) / 2

    def at(focal: float) -> Rectification:
        return replace(unit, focal=focal, centre=half - focal * middle)

    if alpha is None:
        return at(_kept_scale(unit.cameras, unit.image_size))
    all_of_both = float((half / np.max([np.abs(b - middle).max(0) for b in borders], 0)).min())
    no_black = _covering(at, all_of_both) if alpha != 1 else 0.0
    return at((1 - alpha) * no_black + alpha * all_of_both)


def _projection_for(borders: Sequence[Array]) -> str:
    """The projection that holds the rays (N, 3) at the borders of both pictures."""
    reach = max(float(np.arccos(np.clip(b[:, 2], -1, 1)).max(initial=0.0)) for b in borders)
    return LATITUDE_LONGITUDE if reach > WIDE else PERSPECTIVE


def _flat(rays: Array, projection: str, axis: int) -> Array:
    """Equations (1) and (2) before scale and centre are applied; NaN beyond `WIDEST`."""
    x, y, z = np.moveaxis(np.asarray(rays, float), -1, 0)
    length = np.sqrt(x * x + y * y + z * z)
    with np.errstate(invalid="ignore", divide="ignore"):
        if projection == PERSPECTIVE:
            out, limit = np.stack([x / z, y / z], -1), z > np.cos(WIDEST[projection]) * length
        else:
            along, across = (x, y) if axis == 0 else (y, x)
            latitude = np.arcsin(np.clip(along / length, -1, 1))
            pair = [latitude, np.arctan2(across, z)]
            out, limit = (
                np.stack(pair if axis == 0 else pair[::-1], -1),
                np.abs(latitude) <= WIDEST[projection],
            )
    return np.where(limit[..., None], out, np.nan)


def _unflat(m: Array, projection: str, axis: int) -> Array:
    if projection == PERSPECTIVE:
        rays = projective.homogeneous(m)
        return rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    latitude, longitude = m[..., axis], m[..., 1 - axis]
    shown = (np.abs(latitude) <= WIDEST[projection]) & (np.abs(longitude) <= np.pi)
    along, across = np.sin(latitude), np.cos(latitude) * np.sin(longitude)
    rays = np.stack([along, across] if axis == 0 else [across, along], -1)
    rays = np.concatenate([rays, (np.cos(latitude) * np.cos(longitude))[..., None]], -1)
    return np.where(shown[..., None], rays, np.nan)


def _sources(camera: Camera, turn: Array, rays: Array) -> tuple[Array, Array]:
    """Pixels in the picture as taken of directions (..., 3) of the rectified frame, and which of them exist."""
    assert camera.image_size is not None
    seen = camera.project(rays @ turn)
    return seen, in_picture(seen, camera.image_size)


def _border(camera: Camera, turn: Array) -> Array:
    """Directions (N, 3) in the rectified frame of pixels along the sides of a picture and across it."""
    assert camera.image_size is not None
    rays = camera.unproject(border_grid(camera.image_size)) @ turn.T
    return np.asarray(rays[np.isfinite(rays).all(1)])


def _kept_scale(cameras: tuple[Camera, Camera], size: tuple[int, int]) -> float:
    """The smaller of the two scales on the optical axis, px per rad, after scaling the pictures to `size`."""
    found = []
    for camera in cameras:
        d_xyz = camera.lens.jacobians(camera.params, np.array([[0.0, 0.0, 1.0]]))[1]
        scale = float(np.sqrt(abs(np.linalg.det(d_xyz[0, :, :2]))))
        if not np.isfinite(scale):  # the axis is outside the domain of the lens
            scale = float(np.sqrt(abs(np.linalg.det(camera.matrix[:2, :2]))))
        assert camera.image_size is not None
        found.append(scale * min(np.array(size) / np.array(camera.image_size)))
    return min(found)


def _covering(at: Callable[[float], Rectification], low: float) -> float:
    """The smallest scale, of those above `low`, at which every rectified pixel lies in both pictures."""

    def covered(focal: float) -> bool:
        made = at(focal)
        rays = made.rays(border_grid(made.image_size, *made.image_size))
        return all(_sources(c, t, rays)[1].all() for c, t in zip(made.cameras, made.turns, strict=True))

    high = low
    while not covered(high):
        high *= GROWTH
        if high > MOST_ENLARGED * low:
            raise _nothing_shared()
    return bisected(covered, low, high)


def _refuse_epipoles(cameras: tuple[Camera, Camera], turns: Array, axis: int) -> None:
    """Reject perspective pictures that contain an epipole, since rectification would move it to infinity."""
    along = np.eye(3)[axis]
    for camera, turn in zip(cameras, turns, strict=True):
        if _sources(camera, turn, np.stack([along, -along]))[1].any():
            raise EstimationError(
                "an epipole lies within the field of view (one camera is behind the other, or a lens "
                "sees 180 degrees and more), so perspective pictures cannot be rectified.",
                f"Try: --projection {LATITUDE_LONGITUDE}",
            )


def _nothing_shared() -> EstimationError:
    return EstimationError(
        "the rectified pictures have no common area: the cameras look in different directions.",
        "Choose two cameras of the rig that look in similar directions, or give --alpha 1.",
    )
