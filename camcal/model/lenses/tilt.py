"""OpenCV's tilted sensor (Scheimpflug): its homography and the derivatives with respect to the two angles."""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def tilt_matrix(tau_x: float, tau_y: float) -> Array:
    """OpenCV's matTilt (3, 3): the image plane rotated by tau_x about x, then tau_y about y, rad."""
    (x, _), (y, _) = _turn_x(tau_x), _turn_y(tau_y)
    return _onto_plane(y @ x) @ y @ x


def tilt_derivatives(tau_x: float, tau_y: float) -> tuple[Array, Array]:
    """Derivatives (3, 3) of `tilt_matrix` with respect to tau_x and tau_y."""
    (x, dx), (y, dy) = _turn_x(tau_x), _turn_y(tau_y)
    rotation = y @ x
    out = []
    for d in (y @ dx, dy @ x):
        dp = _onto_plane(d)
        dp[2, 2] = 0.0
        out.append(dp @ rotation + _onto_plane(rotation) @ d)
    return out[0], out[1]


def _turn_x(tau: float) -> tuple[Array, Array]:
    """The rotation about x and its derivative."""
    c, s = np.cos(tau), np.sin(tau)
    return np.array([[1, 0, 0], [0, c, s], [0, -s, c]]), np.array([[0, 0, 0], [0, -s, c], [0, -c, -s]])


def _turn_y(tau: float) -> tuple[Array, Array]:
    """The rotation about y and its derivative."""
    c, s = np.cos(tau), np.sin(tau)
    return np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]), np.array([[-s, 0, -c], [0, 0, 0], [c, 0, -s]])


def _onto_plane(r: Array) -> Array:
    """The projection along z onto the plane with the third row of R as its normal."""
    return np.array([[r[2, 2], 0, -r[0, 2]], [0, r[2, 2], -r[1, 2]], [0, 0, 1.0]])
