"""A known rig judged on points: one pose for each instant, for all of its cameras together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from camcal.data.observations import View
from camcal.errors import DataError, EstimationError
from camcal.model.pose import Array, Pose
from camcal.routes.normal import Normal, minimise
from camcal.routes.placed import PlacedCamera
from camcal.routes.pose import find
from camcal.routes.pose_fit import moved, weighted_jacobian

#: points of one camera from which a pose of the rig can start
LEAST = 4


@dataclass(frozen=True)
class RigPoints:
    """The points of one instant.

    Attributes
    ----------
    id : str
    camera : (N,) int array
        Which camera saw each.
    xyz, uv : (N, 3), (N, 2) arrays
    roots : (N,) array
        1 / sigma of each point, per px.
    """

    id: str
    camera: Array
    xyz: Array
    uv: Array
    roots: Array


@dataclass(frozen=True)
class RigView:
    """Where the points of an instant lie, rig_from_board, and predicted less observed pixels (N, 2)."""

    id: str
    pose: Pose
    residuals: Array


def place(cameras: Sequence[PlacedCamera], points: RigPoints) -> RigView:
    """The pose of an instant's points in the frame of the rig, least squares in px over all cameras.

    Raises
    ------
    DataError
        Where no camera sees `LEAST` points.
    EstimationError
        Where no pose puts the points in front of the cameras that see them.
    """
    starts = _starts(cameras, points)
    fits = [_refined(cameras, points, start) for start in starts]
    best = min((f for f in fits if f is not None), key=lambda f: f[1], default=None)
    if best is None:
        raise EstimationError(
            f"view '{points.id}': no pose puts the points in front of the cameras that see them.",
            "Check the names of the cameras, and the poses of the rig.",
        )
    return RigView(points.id, best[0], _residuals(cameras, points, best[0]))


def _starts(cameras: Sequence[PlacedCamera], points: RigPoints) -> list[Pose]:
    """rig_from_board from each camera that sees enough points, all of its solutions."""
    found, refusal = [], None
    for i, camera in enumerate(cameras):
        mine = points.camera == i
        if mine.sum() < LEAST:
            continue
        rig_from_cam = camera.pose.inverse()
        try:
            solutions = find(
                camera.camera, View(points.id, points.xyz[mine], points.uv[mine]), "none"
            ).solutions
        except (DataError, EstimationError) as error:
            refusal = error
            continue
        found += [rig_from_cam @ s.pose for s in solutions]
    if not found:
        raise refusal or DataError(
            f"view '{points.id}': no camera sees {LEAST} points.", "Leave that view out, or add points."
        )
    return found


def _refined(cameras: Sequence[PlacedCamera], points: RigPoints, start: Pose) -> tuple[Pose, float] | None:
    def linearise(pose: Pose) -> Normal | None:
        rows = [_rows(c, points, i, pose) for i, c in enumerate(cameras) if (points.camera == i).any()]
        if any(r is None for r in rows):
            return None
        made = [r for r in rows if r is not None]
        return Normal.dense(np.concatenate([r[0] for r in made]), np.concatenate([r[1] for r in made]))

    fitted = minimise(linearise, lambda pose, step, _: moved(pose, step), start)
    return None if fitted is None else (fitted.state, fitted.normal.cost)


def _rows(camera: PlacedCamera, points: RigPoints, index: int, pose: Pose) -> tuple[Array, Array] | None:
    """Residuals (2N,) and Jacobian (2N, 6) of one camera's points by the pose rig_from_board.

    With x_cam = Rc (R X + t) + tc, a rotation δ of R on the left and a shift s of t move the camera's own
    pose by the rotation Rc δ and the shift Rc s.
    """
    mine = points.camera == index
    own = camera.pose @ pose
    found = weighted_jacobian(camera.camera, points.xyz[mine], points.uv[mine], points.roots[mine], own)
    if found is None:
        return None
    residual, jacobian = found
    turn = camera.pose.rotation
    return residual, np.c_[jacobian[:, :3] @ turn, jacobian[:, 3:] @ turn]


def _residuals(cameras: Sequence[PlacedCamera], points: RigPoints, pose: Pose) -> Array:
    out = np.full((len(points.xyz), 2), np.nan)
    for i, camera in enumerate(cameras):
        mine = points.camera == i
        out[mine] = camera.camera.project((camera.pose @ pose).apply(points.xyz[mine])) - points.uv[mine]
    return out
