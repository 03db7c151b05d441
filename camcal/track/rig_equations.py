"""The information of one instant about the poses of a rig's cameras.

Camera c has the place R_c = cam_from_rig; if it has moved to exp(δ_c) R_c, the board that it sees is off from where the
others and the rig put it by

    r_c = E_c δ_c + F_c x + B_c θ + noise,        noise ~ H_c⁻¹                                            (1)

(rotation about the centroid of its points, rad, and place of that centroid, in the camera's frame), with x the error of
the board's pose in the rig's frame and θ that of the calibration: intrinsics and cam_from_rig. x is eliminated, which
leaves normal equations of δ of all cameras; they lack six directions, as the rig as a whole has no place.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camcal.geometry import rotations as so3
from camcal.model.pose import Pose
from camcal.records import dataclass

Array = np.ndarray

#: eigenvalues of normal equations of unit diagonal, relative to the largest, that count as 0: rounding leaves 1e-15,
#: and directions that data see a hundred thousand times worse than others are 1e-10
NULL = 1e-11


@dataclass(frozen=True)
class Picture:
    """The board in the view of one camera.

    Attributes
    ----------
    camera : int
    cam_from_board : Pose
        From this picture alone.
    centroid : (3,) array
        Of its points, in the board's frame.
    information : (6, 6) array
        Of the rotation about the centroid and its place, 1 / variance.
    gain : (6, F) array
        How they move with the calibration's variables, as `ReducedPoses.gain`.
    points : int
    variance : float
        Of an image coordinate, px².
    """

    camera: int
    cam_from_board: Pose
    centroid: Array
    information: Array
    gain: Array
    points: int
    variance: float


@dataclass(frozen=True)
class Instant:
    """The normal equations of one instant.

    Attributes
    ----------
    name : str
    cameras : tuple of int
        Those that saw the board.
    normal : (6 C, 6 C) array
    right : (6 C,) array
        normal δ = right.
    by_calibration : (6 C, F) array
        How `right` moves with the calibration's variables.
    pixels : float
        δᵀ normal δ times this is the mean squared shift of the points, px², with the board's pose refitted.
    """

    name: str
    cameras: tuple[int, ...]
    normal: Array
    right: Array
    by_calibration: Array
    pixels: float


def instant(name: str, seen: Sequence[Picture], rig: Sequence[Pose], by_rig: Array) -> Instant:
    """The equations (1) of the pictures of one instant, two or more.

    Parameters
    ----------
    rig : sequence of C Pose
        cam_from_rig.
    by_rig : (C, 6, F) array
        d cam_from_rig (rotation on the left, translation) / d variables of the calibration.
    """
    cameras, size = len(rig), by_rig.shape[2]
    best = max(seen, key=lambda p: p.points)
    board = rig[best.camera].inverse() @ best.cam_from_board
    middle = board.apply(best.centroid)
    rows, count = 6 * len(seen), 6 * cameras
    a, f, b = np.zeros((rows, count)), np.zeros((rows, 6)), np.zeros((rows, size))
    r, w = np.zeros(rows), np.zeros((rows, rows))
    for i, p in enumerate(seen):
        at, own = slice(6 * i, 6 * i + 6), slice(6 * p.camera, 6 * p.camera + 6)
        place = rig[p.camera]
        there = board.apply(p.centroid)
        predicted = place.apply(there)
        r[at] = np.r_[
            so3.log(p.cam_from_board.rotation @ (place.rotation @ board.rotation).T),
            p.cam_from_board.apply(p.centroid) - predicted,
        ]
        e = _moved(predicted - place.translation)
        turned = np.kron(np.eye(2), place.rotation)
        a[at, own], f[at], w[at, at] = e, turned @ _moved(there - middle), p.information
        b[at] = p.gain + e @ by_rig[p.camera]
    pixels = float(np.mean([p.variance for p in seen])) / sum(p.points for p in seen)
    wf = w @ f
    wa = w @ a - wf @ np.linalg.solve(f.T @ wf, wf.T @ a)
    return Instant(name, tuple(p.camera for p in seen), a.T @ wa, wa.T @ r, wa.T @ b, pixels)


def inverse(matrix: Array) -> tuple[Array, int]:
    """A generalised inverse of a positive semidefinite matrix whose rows have different units, and its rank.

    The rank is that of the matrix scaled to a unit diagonal; see `NULL`. Solutions by the inverse are orthogonal to the
    null space in the units as they are.
    """
    scale = np.sqrt(np.maximum(np.diagonal(matrix), np.finfo(float).tiny))
    unit = np.outer(scale, scale)
    values, vectors = np.linalg.eigh(matrix / unit)
    kept = values > NULL * max(float(values[-1]), np.finfo(float).tiny)
    found = (vectors[:, kept] / values[kept]) @ vectors[:, kept].T / unit
    if not kept.all():
        null = np.linalg.qr(vectors[:, ~kept] / scale[:, None])[0]
        found = found - null @ (null.T @ found)
        found = found - (found @ null) @ null.T
    return found, int(kept.sum())


def _moved(point: Array) -> Array:
    """d (rotation, position of a point) by (rotation about the origin, translation), (6, 6)."""
    out = np.eye(6)
    out[3:, :3] = -so3.skew(point)
    return out
