"""Poses of a known camera against cv2.solvePnPGeneric and cv2.solvePnPRefineLM."""

from __future__ import annotations

import cv2
import numpy as np

from camcal.geometry import projective, rotations
from camcal.model.camera import Camera
from camcal.model.pose import Array, Pose
from camcal.peers.base import LEAST_POINTS, LOWER_PX, SAME, Entry, entry, judge
from camcal.system.processes import one_opencv_thread

STAGE = "pose"
#: points count as a plane for IPPE below this part of their extent: it drops the third coordinate
PLANE = 1e-9


def against_cv2(camera: Camera, xyz: Array, uv: Array, pose: Pose) -> Entry:
    """The best pose against the best of cv2's, each refined, by their rms_point over the same points.

    Parameters
    ----------
    xyz : (N, 3) array
    uv : (N, 2) array, px
    pose : Pose
        cam_from_world, the minimum of the reprojection error.
    """
    rays = camera.unproject(uv)
    planar, local, frame = _in_own_frame(xyz)
    name = "cv2.solvePnPGeneric" + ("(IPPE)" if planar else "(SQPNP)")
    if len(xyz) < LEAST_POINTS:
        return entry(STAGE, name, "not_applicable", "three points: every solution is exact")
    if (rays[:, 2] < projective.FLAT_RAY).any():
        return entry(
            STAGE, name, "not_applicable", "cv2 accepts only rays less than 90 degrees from the axis"
        )
    ab = np.ascontiguousarray(rays[:, :2] / rays[:, 2:])
    method = cv2.SOLVEPNP_IPPE if planar else cv2.SOLVEPNP_SQPNP
    try:
        with one_opencv_thread():
            found = _solutions(local, ab, method)
    except cv2.error as error:
        return entry(STAGE, name, "not_applicable", f"cv2 refuses: {error.err}")
    theirs = [Pose(r @ frame[0], t + r @ frame[1]) for r, t in found]
    figures = [(_rms(camera, p, xyz, uv), p) for p in theirs]
    figures = [(rms, p) for rms, p in figures if np.isfinite(rms)]
    if not figures:
        return entry(STAGE, name, "not_applicable", "cv2's poses are not finite, or behind the camera")
    rms, best = min(figures, key=lambda f: f[0])
    ours = _rms(camera, pose, xyz, uv)
    # cv2 minimises in normalised coordinates, so that it may come close to the minimum in px but not below
    status, why = judge(ours, rms * (1 + SAME) + LOWER_PX, "rms_point (px)")
    return entry(
        STAGE,
        name,
        status,
        why,
        {"rms_point": rms, **best.entry()},
        {
            "rms_point": ours - rms,
            "rotation_deg": float(np.degrees(rotations.angle_between(pose.rotation, best.rotation))),
            "translation": float(np.linalg.norm(pose.translation - best.translation)),
        },
    )


def _in_own_frame(xyz: Array) -> tuple[bool, Array, tuple[Array, Array]]:
    """Whether points lie on a plane, the points in their own frame (z = 0 there), and R, t into that frame."""
    origin, axes, spread = projective.fit_plane(xyz)
    local = (xyz - origin) @ axes
    planar = bool(spread[2] <= PLANE * spread[0])
    if planar:
        local[:, 2] = 0
    return planar, np.ascontiguousarray(local), (axes.T, -axes.T @ origin)


def _solutions(xyz: Array, ab: Array, method: int) -> list[tuple[Array, Array]]:
    """cv2's poses, refined by its own Levenberg-Marquardt."""
    made = cv2.solvePnPGeneric(xyz, ab, np.eye(3), None, flags=method)
    out = []
    for vector, translation in zip(made[1], made[2], strict=True):
        if not (np.isfinite(vector).all() and np.isfinite(translation).all()):
            continue
        vector, translation = cv2.solvePnPRefineLM(xyz, ab, np.eye(3), None, vector, translation)
        out.append((rotations.exp(vector.ravel()), translation.ravel()))
    return out


def _rms(camera: Camera, pose: Pose, xyz: Array, uv: Array) -> float:
    return float(np.sqrt(np.square(camera.project(pose.apply(xyz)) - uv).sum(1).mean()))
