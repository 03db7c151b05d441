"""Rays of lenses without an exact counterpart in camcal, by Newton's method on the original formula."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from camcal.data.formats.base import ForeignCamera, ForeignLens

Array = np.ndarray
#: px in focal lengths; what is left of the inversion, far below any figure that is printed
SOLVED = 1e-12
STEPS = 50  #: of Newton's method at most, which converges quadratically or not at all
#: the step of the numeric derivatives, in focal lengths: its error is quadratic, that of rounding 1e-10
STEP = 1e-6
#: determinant of the derivative from which on it counts as positive: its differences are rounded to 1e-10
NO_AREA = 1e-12
#: focal lengths; a step is shortened to it: longer ones jump over a fold, which lenses have at .5 and beyond
LONGEST = 0.3
#: focal lengths; a pixel is inverted where no more is left: SOLVED with the rounding of strong distortion
FOUND = 1e-9
Plane = Callable[[Array], Array]


def inverse(forward: Plane, target: Array) -> tuple[Array, Array]:
    """Points w (N, 2) with forward(w) = target, and the mask of those that were found.

    Damped Newton with central differences from w = target.
    """
    w = target.copy()
    left = forward(w) - target
    for _ in range(STEPS):
        columns = [(forward(w + h) - forward(w - h)) / (2 * STEP) for h in np.eye(2) * STEP]
        j = np.stack(columns, -1)
        det = j[:, 0, 0] * j[:, 1, 1] - j[:, 0, 1] * j[:, 1, 0]
        safe = np.where(det > NO_AREA, det, np.nan)  # past a fold the derivative changes its sign
        step = np.c_[
            (j[:, 1, 1] * left[:, 0] - j[:, 0, 1] * left[:, 1]) / safe,
            (j[:, 0, 0] * left[:, 1] - j[:, 1, 0] * left[:, 0]) / safe,
        ]
        length = np.linalg.norm(step, axis=1, keepdims=True)
        step *= np.minimum(1.0, LONGEST / np.maximum(length, 1e-300))  # no jump over a fold
        w = w - step
        left = forward(w) - target
        if not (np.linalg.norm(left, axis=1) > SOLVED).any():
            break
    return w, np.asarray(np.linalg.norm(left, axis=1) < FOUND)


def on_plane(w: Array) -> Array:
    """Rays of points x/z, y/z (N, 2)."""
    rays = np.c_[w, np.ones(len(w))]
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


def at_angle(w: Array) -> Array:
    """Rays of points (N, 2) whose length is the angle from the axis, rad."""
    angle = np.linalg.norm(w, axis=1)
    return np.c_[w * np.sinc(angle / np.pi)[:, None], np.cos(angle)]


def foreign_camera(
    name: str,
    reason: str,
    matrix: Iterable[float],
    size: tuple[int, int] | None,
    forward: Plane,
    rays: Callable[[Array], Array] = on_plane,
) -> ForeignCamera:
    """A camera whose lens maps the ideal point (N, 2) to the point in focal lengths by `forward`.

    `rays` says what the ideal point is: `on_plane` or `at_angle`.
    """
    fx, fy, cx, cy, skew = matrix

    def unproject(uv: Array) -> tuple[Array, Array]:
        y = (uv[:, 1] - cy) / fy
        target = np.c_[(uv[:, 0] - cx - skew * y) / fx, y]
        with np.errstate(all="ignore"):
            w, found = inverse(forward, target)
            if rays is at_angle:
                found = found & (np.linalg.norm(w, axis=1) < np.pi)
            return np.where(found[:, None], rays(w), np.nan), found

    return ForeignCamera(ForeignLens(name, reason, unproject), size)


def backward_camera(
    name: str, reason: str, matrix: Iterable[float], size: tuple[int, int] | None, undistort: Plane
) -> ForeignCamera:
    """A camera whose lens is defined from the picture to the scene: x/z, y/z of a point in focal lengths."""
    fx, fy, cx, cy, skew = matrix

    def unproject(uv: Array) -> tuple[Array, Array]:
        y = (uv[:, 1] - cy) / fy
        with np.errstate(all="ignore"):
            w = undistort(np.c_[(uv[:, 0] - cx - skew * y) / fx, y])
        found = np.asarray(np.isfinite(w).all(1))
        return np.where(found[:, None], on_plane(np.where(found[:, None], w, 0.0)), np.nan), found

    return ForeignCamera(ForeignLens(name, reason, unproject), size)
