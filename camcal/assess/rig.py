"""The uncertainty of the relative poses of a rig's cameras.

With cam_from_rig perturbed on the left, exp(δ_r) R and t + δ_t, the centre C = -Rᵀ t of a camera moves by

    dC = -Rᵀ δ_t + Rᵀ (δ_r × t)                                                                         (1)

and the distance of two cameras by uᵀ (dC_a - dC_b), u the direction between them. The size of a board whose shape is
estimated is that of the ideal points nearest to it (`solve.board.settle`), not that of the points which hold the
gauge of the estimate, so that all lengths carry the factor s with

    d log s / dθ = -Σ a_i · dX_i/dθ / Σ |a_i|²,     a: ideal points about their centroid                (2)
"""

from __future__ import annotations

import numpy as np

from camcal.assess.covariance import Covariance
from camcal.data.boards import movable, parts
from camcal.geometry import rotations
from camcal.model.pose import Pose
from camcal.solve.calibration import RigCalibration

Array = np.ndarray


def relative_sigmas(solution: RigCalibration, accuracy: Covariance, name: str) -> Array:
    """Standard deviations (6,) of cam_from_rig: rotation (rad, on the left), translation; 0 for the reference."""
    rows = pose_rows(solution, name)
    return _sigmas(rows, accuracy)


def baseline_sigma(solution: RigCalibration, accuracy: Covariance, a: str, b: str) -> float:
    """The standard deviation of the distance between two cameras; inf if it is undetermined."""
    rig = solution.rig
    apart = rig.cam_from_rig[a].centre - rig.cam_from_rig[b].centre
    length = float(np.linalg.norm(apart))
    if length == 0:
        return float("inf")
    row = apart / length @ (_centre_rows(solution, a) - _centre_rows(solution, b))
    return float(_sigmas(row[None], accuracy)[0])


def _sigmas(rows: Array, accuracy: Covariance) -> Array:
    """Standard deviations (K,) of linear functions (K, F) of the variables; inf where undetermined."""
    if not np.isfinite(accuracy.sigma_0):
        return np.full(len(rows), np.inf)
    found = np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", rows, accuracy.free, rows), 0.0))
    lost = np.abs(rows @ accuracy.null).max(-1, initial=0.0) > 0
    return np.where(lost, np.inf, found)


def pose_rows(solution: RigCalibration, name: str) -> Array:
    """d cam_from_rig / d variables (6, F)."""
    rows = np.zeros((6, solution.free.shape[1]))
    at = solution.extrinsics.get(name)
    if at is not None:
        rows[:, at] = np.eye(6)
        rows[3:] += np.outer(solution.rig.cam_from_rig[name].translation, _scale_row(solution))
    return rows


def board_sigmas(solution: RigCalibration, accuracy: Covariance) -> Array:
    """Standard deviations (K, 6) of the poses group_from_board of the estimated boards: rotation, translation.

    The variables turn a board about the mean c of its points (`camcal.solve.board`): δt = τ + ω x (t - c).
    """
    board, data = solution.board, solution.observations
    if board is None or not board.placed or data.target is None:
        return np.zeros((0, 6))
    found, part, kept = [], parts(data), data.used
    assert part is not None
    begin = solution.free.shape[1] - board.size
    for k, index in enumerate(movable(data.target)):
        rows = np.zeros((6, solution.free.shape[1]))
        rows[:, begin + 6 * k : begin + 6 * k + 6] = np.eye(6)
        points = np.unique(data.xyz[(part == k) & kept], axis=0)
        arm = Pose.from_entry(data.target["board_poses"][index]).translation - points.mean(0)
        rows[3:, begin + 6 * k : begin + 6 * k + 3] = -rotations.skew(arm)
        found.append(_sigmas(rows, accuracy))
    return np.array(found).reshape(-1, 6)


def _centre_rows(solution: RigCalibration, name: str) -> Array:
    """(1) as d centre / d variables (3, F)."""
    pose, rows = solution.rig.cam_from_rig[name], pose_rows(solution, name)
    return pose.rotation.T @ (-rows[3:] - rotations.skew(pose.translation) @ rows[:3])


def _scale_row(solution: RigCalibration) -> Array:
    """(2) as a row (F,)."""
    row, board = np.zeros(solution.free.shape[1]), solution.board
    if board is not None and board.label is None:  # the sizes of several boards are given
        ideal = board.ideal - board.ideal.mean(0)
        moved = np.einsum("mi,mib->b", ideal, board.directions().reshape(len(ideal), 3, -1))
        row[len(row) - board.size :] = -moved / np.square(ideal).sum()
    return row
