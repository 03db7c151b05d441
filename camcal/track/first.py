"""The camera at the start of a track, robust against outliers, and the reasons not to start."""

from __future__ import annotations

import math

import numpy as np

from camcal.errors import DataError, EstimationError
from camcal.geometry import dlt, projective
from camcal.track import noise, robust
from camcal.track.frames import Frame
from camcal.track.model import Model

Array = np.ndarray

#: points that scatter about a camera by more than so many times the noise show no camera
SCATTER = 3.0
#: nor do points that scatter by more than this part of their own extent in the picture: of points matched
#: at random the best camera leaves about three quarters of it
BLIND = 0.2


def fit(model: Model, frame: Frame, known: float | None, probability: float) -> robust.FrameFit:
    """Fit a camera to the first frame, or to the first few frames joined.

    Parameters
    ----------
    known : float or None
        Noise of the image points, px; a factor if they have sigmas.
    probability : float
        Of taking a good point for an outlier.

    Raises
    ------
    EstimationError
        If the points do not determine a camera, or fit none.
    DataError
        If they contradict every camera.
    """
    needed = model.start_points
    different = len(np.unique(frame.xyz, axis=0))
    if different < needed:
        raise EstimationError(
            f"{different} different points in the first frames; {needed} are needed to start.",
            "Give the first frames more points"
            + (
                "; with a known camera four suffice: --camera CALIBRATION.yaml --fix intrinsics"
                * (needed > 4)
            ),
        )
    model.settle(frame)
    x = model.start(frame)
    spare = math.inf if known is not None else 2 * len(frame) - model.size
    found = robust.fit(model, x, frame, known, noise.gate(probability, spare), model.prior(x))
    _check_scatter(found, frame, known)
    if found.keep.sum() < needed:
        raise EstimationError(
            f"{int(found.keep.sum())} of {len(frame)} points fit one camera; {needed} are needed.",
            "Check the assignment of image points to world points.",
        )
    return found


def _check_scatter(found: robust.FrameFit, frame: Frame, known: float | None) -> None:
    if known is not None and found.scatter > SCATTER * known:
        said = f"their sigma ({known:.3g} px) says" if frame.sigma is None else "their sigmas say"
        wrong = "--sigma" if frame.sigma is None else "the column sigma"
        raise EstimationError(
            f"the points of the first frames lie {found.scatter / known:.2g} times as far from any camera as "
            f"{said}.",
            f"Correct or remove {wrong}"
            + ("." if frame.sigma is None else ", or learn a factor of it: --learn-noise"),
        )
    own = 1.0 if frame.sigma is None else float(np.median(frame.sigma))
    _refuse_disorder(found.scatter * own, frame.uv)


def _refuse_disorder(scatter: float, uv: Array) -> None:
    """Reject points whose nearest camera leaves as much of their images (N, 2) as points matched at random do, px."""
    if scatter > BLIND * float(np.sqrt(uv.var(0).sum())):
        raise EstimationError(
            f"the points of the first frames fit no camera: the residuals of the nearest are {scatter:.3g} px.",
            "Check the assignment of image points to world points.",
        )


# ---------------------------------------------------------------------- projection matrices
#: out-of-plane extent against the largest, below which points count as lying on a plane
FLAT = 1e-4
#: last but one singular value of the DLT against the largest, below which M is not determined
UNDETERMINED = 1e-7
SAMPLE = 6  #: points of a sample: twelve equations for the eleven numbers of M
#: points from which samples are drawn: of fewer, nearly all samples hold a single outlier
LEAST_SAMPLED = 8
#: samples of six points: 99.9 % of drawing one without an outlier among 40 % of them
SAMPLES = 150

PLANE = "the points lie on a plane: a single fixed view of it determines 8 of the 11 numbers of M."
#: the same for the estimators on K, R, t
PLANE_INTRINSICS = (
    "the points lie on a plane and the camera hardly moves: one view of a plane does not determine the "
    "intrinsics besides the pose."
)
PLANE_HINT = (
    "Fix the intrinsics: --method iekf --camera CALIBRATION.yaml --fix intrinsics; "
    "or use a target with points in space."
)


def projection_matrix(xyz: Array, uv: Array) -> Array:
    """M (3, 4) of points xyz (N, 3) and images uv (N, 2), robust against outliers.

    Least quantile of squares over samples of six points (Rousseeuw 1984), the same samples on every run. The
    centroid of the points lies at a positive depth.

    Raises
    ------
    EstimationError
        If the points lie on a plane or otherwise do not determine M, or where only a mirrored camera comes near
        them and that fits no better than points matched at random.
    DataError
        If the world's frame is left-handed.
    """
    if is_flat(xyz):
        raise EstimationError(PLANE, PLANE_HINT)
    matrices, singular = dlt.solve(xyz[None], uv[None])
    if singular[0, 10] <= UNDETERMINED * singular[0, 0]:
        raise EstimationError(
            "the points leave the projection matrix undetermined (a degenerate arrangement).",
            "Use points that fill a volume.",
        )
    candidates = np.concatenate([matrices, _sampled(xyz, uv)])
    distance = _distances(candidates, xyz, uv)
    rank = robust.majority(len(xyz), 11) - 1
    nearest = np.partition(distance, rank, axis=1)[:, rank]
    best = candidates[nearest.argmin()]
    if np.linalg.det(best[:, :3]) < 0:
        _refuse_disorder(float(nearest.min()), uv)  # a matrix of points in disorder has either sign
        raise DataError(
            "the world's frame is left-handed: no camera sees the points as they are given.",
            "Swap two of the coordinates X, Y, Z (or u and v), or change the sign of one.",
        )
    return best


def is_flat(xyz: Array) -> bool:
    """Return whether points (N, 3) lie on a plane."""
    spread = projective.fit_plane(xyz)[2]
    return bool(spread[2] <= FLAT * spread[0])


def _sampled(xyz: Array, uv: Array) -> Array:
    if len(xyz) < LEAST_SAMPLED:
        return np.zeros((0, 3, 4))
    rng = np.random.default_rng(0)
    rows = rng.random((SAMPLES, len(xyz))).argpartition(SAMPLE, axis=1)[:, :SAMPLE]
    return dlt.projection_matrices(xyz[rows], uv[rows])


def _distances(matrices: Array, xyz: Array, uv: Array) -> Array:
    """Distances (S, N) of the projections, px; inf behind the camera."""
    image = projective.homogeneous(xyz) @ np.swapaxes(matrices, 1, 2)
    depth = image[..., 2]
    safe = np.where(depth > 0, depth, 1.0)
    r = image[..., :2] / safe[..., None] - uv
    return np.where(depth > 0, np.sqrt((r**2).sum(-1)), np.inf)
