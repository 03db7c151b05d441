"""Straightness of lines, in the original picture and after removing distortion."""

from __future__ import annotations

import numpy as np

from camcal.model.camera import Camera
from camcal.model.pose import Array
from camcal.records import dataclass
from camcal.routes.line_geometry import Lines, distances


@dataclass(frozen=True)
class Straightness:
    """Distances of points from the straight lines nearest to them, px, over all points."""

    rms: float
    max: float
    line_rms: Array  #: (L,)


def undistorted(camera: Camera, uv: Array) -> Array:
    """Pixels (N, 2) without the distortion, at the picture's scale about the optical axis; NaN beyond 90 degrees."""
    rays = camera.unproject(uv)
    axis, d_xyz, _, _ = camera.lens.jacobians(camera.params, np.array([[0.0, 0, 1]]))
    with np.errstate(invalid="ignore", divide="ignore"):
        flat = np.where(rays[:, 2:] > 0, rays[:, :2] / rays[:, 2:], np.nan)
    return axis[0] + flat @ d_xyz[0, :, :2].T


def before(lines: Lines) -> Straightness:
    """The straightness of the original points."""
    return _of_points(lines.uv, lines)


def after(camera: Camera, lines: Lines) -> Straightness:
    """The straightness of the undistorted points, at the scale of the picture on the optical axis.

    If a ray is at 90 degrees or beyond, distances in the original picture are used instead.
    """
    flat = undistorted(camera, lines.uv)
    if np.isfinite(flat).all():
        return _of_points(flat, lines)
    return _summary(distances(camera, lines), lines)


def in_picture(camera: Camera, lines: Lines) -> Straightness:
    """Distances from the images of straight lines, in the original picture."""
    return _summary(distances(camera, lines), lines)


def directions(camera: Camera, lines: Lines) -> Array:
    """Angles (L,) of the undistorted lines in the picture, rad, modulo π."""
    flat = undistorted(camera, lines.uv)
    flat = np.where(np.isfinite(flat), flat, lines.uv)
    centred, scatter = _scatter(flat, lines)
    del centred
    main = np.linalg.eigh(scatter)[1][:, :, 1]
    return np.arctan2(main[:, 1], main[:, 0]) % np.pi


def _of_points(uv: Array, lines: Lines) -> Straightness:
    centred, scatter = _scatter(uv, lines)
    normal = np.linalg.eigh(scatter)[1][:, :, 0]
    return _summary((normal[lines.line] * centred).sum(1), lines)


def _scatter(uv: Array, lines: Lines) -> tuple[Array, Array]:
    """Points about their line's centroid (N, 2), and their second moments (L, 2, 2)."""
    counts = np.maximum(np.bincount(lines.line, minlength=len(lines)), 1)
    centre = np.stack([np.bincount(lines.line, uv[:, k], len(lines)) for k in (0, 1)], 1) / counts[:, None]
    centred = uv - centre[lines.line]
    scatter = np.zeros((len(lines), 2, 2))
    np.add.at(scatter, lines.line, centred[:, :, None] * centred[:, None])
    return centred, scatter


def _summary(off: Array, lines: Lines) -> Straightness:
    counts = np.maximum(np.bincount(lines.line, minlength=len(lines)), 1)
    per_line = np.sqrt(np.bincount(lines.line, off**2, len(lines)) / counts)
    return Straightness(float(np.sqrt((off**2).mean())), float(np.abs(off).max(initial=0)), per_line)
