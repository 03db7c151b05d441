"""First estimates: projection matrices and poses from points among which some are wrong."""

from __future__ import annotations

import numpy as np

from camcal.errors import DataError, EstimationError
from camcal.geometry import dlt as resection
from camcal.geometry import projective
from camcal.track.robust import majority

Array = np.ndarray

#: out-of-plane extent against the largest, below which points count as lying on a plane
FLAT = 1e-4
#: last but one singular value of the DLT against the largest, below which M is not determined
UNDETERMINED = 1e-7
#: samples of six points: 99.9 % of drawing one without an outlier among 40 % of them
SAMPLES = 150

PLANE = (
    "the points lie on a plane: a single fixed view of it leaves the 11 numbers of M open (it determines 8)."
)
#: the same for the estimators on K, R, t
PLANE_INTRINSICS = (
    "the points lie on a plane and the camera hardly moves: one view of a plane does not determine the "
    "intrinsics besides the pose."
)
PLANE_HINT = (
    "Hold the intrinsics: --method iekf --camera CALIBRATION.yaml --fix intrinsics; "
    "or use a target with points in space."
)


def projection_matrix(xyz: Array, uv: Array) -> Array:
    """M (3, 4) of points xyz (N, 3) and images uv (N, 2), outliers among them.

    Least quantile of squares over samples of six points (Rousseeuw 1984), the same samples on every run. The
    centroid of the points lies at a positive depth.

    Raises
    ------
    EstimationError
        Where the points lie on a plane or otherwise leave M open.
    DataError
        Where the world's frame is left-handed.
    """
    if is_flat(xyz):
        raise EstimationError(PLANE, PLANE_HINT)
    matrices, singular = resection.solve(xyz[None], uv[None])
    if singular[0, 10] <= UNDETERMINED * singular[0, 0]:
        raise EstimationError(
            "the points leave the projection matrix open (a degenerate arrangement).",
            "Use points that fill a volume.",
        )
    candidates = np.concatenate([matrices, _sampled(xyz, uv)])
    distance = _distances(candidates, xyz, uv)
    rank = majority(len(xyz), 11) - 1
    best = candidates[np.partition(distance, rank, axis=1)[:, rank].argmin()]
    if np.linalg.det(best[:, :3]) < 0:
        raise DataError(
            "the world's frame is left-handed: no camera sees the points as they are given.",
            "Swap two of the coordinates X, Y, Z (or u and v), or change the sign of one.",
        )
    return best


def is_flat(xyz: Array) -> bool:
    """Whether points (N, 3) lie on a plane."""
    spread = projective.fit_plane(xyz)[2]
    return bool(spread[2] <= FLAT * spread[0])


def _sampled(xyz: Array, uv: Array) -> Array:
    if len(xyz) < 8:
        return np.zeros((0, 3, 4))
    rng = np.random.default_rng(0)
    rows = rng.random((SAMPLES, len(xyz))).argpartition(6, axis=1)[:, :6]
    return resection.projection_matrices(xyz[rows], uv[rows])


def _distances(matrices: Array, xyz: Array, uv: Array) -> Array:
    """Distances (S, N) of the projections, px; inf behind the camera."""
    image = projective.homogeneous(xyz) @ np.swapaxes(matrices, 1, 2)
    depth = image[..., 2]
    safe = np.where(depth > 0, depth, 1.0)
    r = image[..., :2] / safe[..., None] - uv
    return np.where(depth > 0, np.sqrt((r**2).sum(-1)), np.inf)
