"""Poses from which a camera sees a whole object, spread over the picture, directions and distances."""

from __future__ import annotations

import numpy as np

from camcal.errors import UsageError
from camcal.geometry import rotations
from camcal.model.camera import Camera
from camcal.model.pose import Pose, Poses
from camcal.records import dataclass

Array = np.ndarray

#: rad: successive azimuths at this angle never come close to repeating (H. Vogel 1979)
GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))
#: rad: standard deviation of the azimuths about these, a quarter of the distance of neighbours in 13 views
SCATTER = 0.1
#: part of the requested size: an object that has to be smaller is refused
LEAST_SHARE = 0.75
#: attempts at a place in the picture, each with an object smaller by this factor until `LEAST_SHARE`, and closer to the
#: middle by at least this part: after forty, 1e-4 of the way is left
ATTEMPTS, SMALLER, TOWARDS = 40, 0.97, 0.2
#: fill is met to this part; the search for the distance takes six steps for most lenses, and at most so many
FILL_ERROR, STEPS = 0.005, 30
#: factor by which an object that leaves the lens's domain is moved away, and the range of a step of the search
AWAY, STEP_RANGE = 1.5, (0.7, 1.4)
#: steps of the additive recurrence that fills a square evenly (Roberts 2018, "R2", from the plastic number)
R2_STEP = np.array([0.7548776662466927, 0.5698402909980532])


@dataclass(frozen=True)
class Spread:
    """How much the poses differ from each other.

    Attributes
    ----------
    tilt : (low, high)
        Angle between the object's z axis and the line of sight, degrees.
    fill : (low, high)
        Part of the picture's width or height, whichever is filled more, that the object takes up.
    roll : float
        Largest turn about the line of sight, degrees.
    margin : float
        Part of the picture at each side that stays free.
    """

    tilt: tuple[float, float] = (5.0, 45.0)
    fill: tuple[float, float] = (0.45, 0.8)
    roll: float = 20.0
    margin: float = 0.02


def simulate_poses(
    points: Array,
    camera: Camera,
    rng: np.random.Generator,
    views: int,
    spread: Spread | None = None,
    base: Array | None = None,
) -> Poses:
    """Choose poses that keep all points in the picture.

    The azimuths of the tilt follow the golden angle, and the places in the picture a low-discrepancy sequence, so that
    few views already cover both. A small random part is added to each.

    Parameters
    ----------
    points : (N, 3) array
        The object's outline, or all its points.
    camera : Camera
    rng : Generator
    views : int
    spread : Spread, optional
    base : (3, 3) array, optional
        Rotation that turns the object to face the camera; none for a board.

    Returns
    -------
    Poses
        cam_from_object.

    Raises
    ------
    UsageError
        If no pose shows all points within the limits.
    """
    spread = spread or Spread()
    base = np.eye(3) if base is None else base
    start, turn = rng.random(2), rng.uniform(0, 2 * np.pi)
    steps = (np.arange(views) + rng.random(views)) / views
    tilts, fills = (low + (high - low) * rng.permutation(steps) for low, high in (spread.tilt, spread.fill))
    made = []
    for i in range(views):
        azimuth = turn + i * GOLDEN_ANGLE + rng.normal(0, SCATTER)
        roll = np.deg2rad(rng.uniform(-spread.roll, spread.roll))
        axis = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        turned = rotations.exp(np.deg2rad(tilts[i]) * axis) @ rotations.exp(np.array([0, 0, roll])) @ base
        place = (start + (i + 1) * R2_STEP) % 1
        made.append(_place(points, camera, turned, place, fills[i], spread.margin))
    return Poses.stack(made)


def _place(points: Array, camera: Camera, rotation: Array, place: Array, fill: float, margin: float) -> Pose:
    """Put the object at `place` (0 to 1) of the picture, moved towards the middle as far as necessary."""
    assert camera.image_size is not None
    size = np.array(camera.image_size, float)
    low, high = margin * size - 0.5, (1 - margin) * size - 0.5
    pixel = -0.5 + place * size
    for attempt in range(ATTEMPTS):
        pose = _at_pixel(points, camera, rotation, pixel, fill * max(SMALLER**attempt, LEAST_SHARE))
        if pose is not None:
            uv = camera.project(pose.apply(points))
            lack = np.maximum(low - uv.min(0), 0) - np.maximum(uv.max(0) - high, 0)
            if not lack.any():
                return pose
            middle = (size - 1) / 2 - pixel
            # as far as what sticks out, but at least a little, toward the middle
            pixel = pixel + np.where(np.abs(lack) > TOWARDS * np.abs(middle), lack, TOWARDS * middle)
        else:
            pixel = pixel + TOWARDS * ((size - 1) / 2 - pixel)
    raise UsageError(
        f"no pose shows the whole object at {fill:.0%} of the picture.",
        "Ask for smaller views or less tilt: --fill 0.3,0.5 --tilt 5,30",
    )


def _at_pixel(points: Array, camera: Camera, rotation: Array, pixel: Array, fill: float) -> Pose | None:
    """The pose with the object's centre on the pixel's ray, at the distance at which it fills the given fraction."""
    assert camera.image_size is not None
    ray = camera.unproject(pixel)
    if not np.isfinite(ray).all():
        return None
    facing = _rotation_onto(ray) @ rotation
    centre = (points.min(0) + points.max(0)) / 2
    extent = float(np.linalg.norm(points - centre, axis=1).max())
    distance, known = 3.0 * extent, None
    for _ in range(STEPS):
        pose = Pose(facing, ray * distance - facing @ centre)
        uv = camera.project(pose.apply(points))
        if not np.isfinite(uv).all():
            distance *= AWAY
            continue
        known = pose
        ratio = float((np.ptp(uv, axis=0) / camera.image_size).max()) / fill
        if abs(ratio - 1) < FILL_ERROR:
            break
        distance *= np.clip(ratio, *STEP_RANGE)
    return known


def _rotation_onto(ray: Array) -> Array:
    """The smallest rotation that takes the z axis to a direction."""
    axis = np.cross([0.0, 0.0, 1.0], ray)
    sine, cosine = np.linalg.norm(axis), ray[2]
    if sine < 1e-12:  # a rotation by less moves no point by a millionth of a px
        return np.eye(3)
    return rotations.exp(axis / sine * np.arctan2(sine, cosine))
