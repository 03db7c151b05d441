"""The accuracy of pairs of cameras of a rig: epipolar lines, and points triangulated from both.

A point at X in the frame of the rig is seen at u_c = π_c(R_c X + t_c) by camera c. With J_c = du_c/dX, P_c = du_c/dθ by
all variables of the calibration, and C their covariance, a point that stays where camera a sees it moves in camera b by

    δu_b = (P_b - J_b J_a⁺ P_a) δθ                                                                      (1)

of which the part across the epipolar line is an error of the calibration that no depth explains. A point found from
both pictures has, with J, P the rows of both and σ the noise of a coordinate, the covariance

    J⁺ (σ² I + P C Pᵀ) J⁺ᵀ                                                                              (2)

(Hartley & Zisserman, Multiple View Geometry, 2004, sections 5.2 and 12.6).
"""

from __future__ import annotations

import numpy as np

from camcal.assess.covariance import Covariance
from camcal.assess.difference import grid_of
from camcal.assess.rig import pose_rows
from camcal.geometry import rotations
from camcal.geometry.picture import in_picture
from camcal.records import dataclass
from camcal.solve.calibration import RigCalibration

Array = np.ndarray

#: columns of the grid over the first camera's picture
COLUMNS = 13
#: relative change of a distance that gives the direction of an epipolar line
STEP = 1e-4


@dataclass(frozen=True)
class PairUncertainty:
    """The uncertainty at one distance from the first camera.

    Attributes
    ----------
    distance : float
        Unit of the data.
    pixels : (N, 2) array
        Of the first camera; those whose points the second one sees, too.
    epipolar : (N,) array
        Standard deviation of the distance from the epipolar line in the second camera, px, by the calibration.
    point : (N,) array
        Standard deviation in the worst direction of a point found from both pictures, unit of the data.
    of_calibration : (N,) array
        The part of it that comes from the calibration; the rest is the noise of the two image points.
    """

    distance: float
    pixels: Array
    epipolar: Array
    point: Array
    of_calibration: Array


def pair_uncertainty(
    solution: RigCalibration, accuracy: Covariance, a: str, b: str, distance: float, noise: float
) -> PairUncertainty:
    """(1) and (2) over the picture of camera a.

    Parameters
    ----------
    distance : float
        Of the points from camera a.
    noise : float
        Standard deviation of a coordinate of an image point, px.
    """
    pixels = _pixels(solution, a)
    xyz = _points(solution, a, pixels, np.full(len(pixels), distance))
    seen = _inside(solution, b, xyz)
    pixels, xyz = pixels[seen], xyz[seen]
    (ja, pa), (jb, pb) = (_derivatives(solution, n, xyz) for n in (a, b))
    move = pb - jb @ np.linalg.pinv(ja) @ pa
    across = _across(solution, a, b, pixels, np.full(len(pixels), distance))
    row = np.einsum("ni,nif->nf", across, move)
    epipolar = np.sqrt(np.maximum(np.einsum("nf,fg,ng->n", row, accuracy.free, row), 0.0))
    both, moves = np.concatenate([ja, jb], 1), np.concatenate([pa, pb], 1)
    back = np.linalg.pinv(both)
    part = back @ (moves @ accuracy.free @ moves.transpose(0, 2, 1)) @ back.transpose(0, 2, 1)
    whole = part + noise**2 * back @ back.transpose(0, 2, 1)
    return PairUncertainty(distance, pixels, epipolar, _worst(whole), _worst(part))


def epipolar_residuals(solution: RigCalibration, a: str, b: str) -> Array:
    """Signed distances (N,) of points seen by both cameras from their epipolar lines in camera b, px.

    Of the used points; a point is taken to be as far from camera a as the board.
    """
    data, index = solution.observations, [list(solution.rig.cameras).index(n) for n in (a, b)]
    rows = [np.flatnonzero(data.used & (data.camera == i)) for i in index]
    _, which = np.unique(data.xyz, axis=0, return_inverse=True)
    keys = which.reshape(-1) + data.view * (int(which.max(initial=0)) + 1)
    _, first, second = np.intersect1d(keys[rows[0]], keys[rows[1]], return_indices=True)
    i, j = rows[0][first], rows[1][second]
    if not len(i):
        return np.zeros(0)
    board = solution.rig.cam_from_rig[a] @ solution.poses[data.view[i]]
    far = np.linalg.norm(board.apply(data.xyz[i]), axis=1)
    xyz = _points(solution, a, data.uv[i], far)
    found = solution.rig.cameras[b].project(solution.rig.cam_from_rig[b].apply(xyz))
    off = np.einsum("ni,ni->n", data.uv[j] - found, _across(solution, a, b, data.uv[i], far))
    return np.asarray(off[np.isfinite(off)])


def board_distance(solution: RigCalibration, a: str) -> float:
    """The median distance of the boards from a camera."""
    data, index = solution.observations, list(solution.rig.cameras).index(a)
    rows = data.used & (data.camera == index)
    placed = (solution.rig.cam_from_rig[a] @ solution.poses[data.view[rows]]).apply(data.xyz[rows])
    return float(np.median(np.linalg.norm(placed, axis=1)))


def _pixels(solution: RigCalibration, a: str) -> Array:
    size = solution.rig.cameras[a].image_size
    if size is not None:
        return grid_of(size, COLUMNS)
    index = list(solution.rig.cameras).index(a)
    uv = solution.observations.uv[solution.observations.camera == index]
    low, high = uv.min(0), uv.max(0)
    u, v = np.meshgrid(*(np.linspace(low[k], high[k], COLUMNS) for k in (0, 1)))
    return np.stack([u.ravel(), v.ravel()], 1)


def _points(solution: RigCalibration, a: str, pixels: Array, distances: Array) -> Array:
    """Points (N, 3) of the rig's frame at pixels of camera a and a given distance."""
    rays = solution.rig.cameras[a].unproject(pixels) * distances[:, None]
    return solution.rig.cam_from_rig[a].inverse().apply(rays)


def _inside(solution: RigCalibration, b: str, xyz: Array) -> Array:
    """Return which points (N,) camera b has in its picture."""
    camera = solution.rig.cameras[b]
    with np.errstate(invalid="ignore"):
        uv = camera.project(solution.rig.cam_from_rig[b].apply(xyz))
        seen = np.isfinite(uv).all(1)
        if camera.image_size is not None:
            seen &= in_picture(uv, camera.image_size)
    return seen


def _across(solution: RigCalibration, a: str, b: str, pixels: Array, distances: Array) -> Array:
    """The direction (N, 2) perpendicular to the epipolar line in camera b, for pixels of camera a."""
    rig = solution.rig
    near, far = (
        rig.cameras[b].project(rig.cam_from_rig[b].apply(_points(solution, a, pixels, distances * k)))
        for k in (1 - STEP, 1 + STEP)
    )
    along = far - near
    with np.errstate(invalid="ignore", divide="ignore"):
        along = along / np.linalg.norm(along, axis=1, keepdims=True)
    return np.stack([-along[:, 1], along[:, 0]], 1)


def _derivatives(solution: RigCalibration, name: str, xyz: Array) -> tuple[Array, Array]:
    """J (N, 2, 3) and P (N, 2, F) of a camera at points (N, 3) of the rig's frame."""
    camera, pose = solution.rig.cameras[name], solution.rig.cam_from_rig[name]
    turned = xyz @ pose.rotation.T
    _, by_xyz, by_params, _ = camera.lens.jacobians(camera.params, turned + pose.translation)
    row = 0
    for other, before in solution.rig.cameras.items():
        if other == name:
            break
        row += before.lens.size
    moved = by_params @ solution.free[row : row + camera.lens.size]
    place = pose_rows(solution, name)
    shifts = np.concatenate([-rotations.skew(turned), np.tile(np.eye(3), (len(xyz), 1, 1))], 2) @ place
    return by_xyz @ pose.rotation, moved + by_xyz @ shifts


def _worst(covariance: Array) -> Array:
    return np.sqrt(np.maximum(np.linalg.eigvalsh(covariance)[:, -1], 0.0))
