"""Which points of a view agree with one projective map: LO-RANSAC with the noise found along (LMedS).

Fischler & Bolles 1981; the scale from the least median of squares (Rousseeuw & Leroy 1987, section 5.1),
because the noise is not known in advance and a pinhole map leaves the lens's distortion in the residuals;
local optimisation of each new best model (Chum, Matas & Kittler 2003). Hypotheses are solved and scored in
batches.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from camcal.closed_form import dlt
from camcal.geometry import homography, projective
from camcal.refine.losses import RAYLEIGH_MEDIAN
from camcal.types import Array, View

#: hypotheses solved and scored at a time
_BATCH = 128
#: a point agrees up to this many σ: 1 % of Gaussian ones do not
_REACH = 3.03
#: σ below this, px, only says that the data are exact
_FLOOR = 1e-6


@dataclass(frozen=True)
class Map:
    """A map from points to the image: how many points fix it, and how it is solved and applied in batches.

    `solve` takes points (H, n, d), images (H, n, 2) and returns matrices (H, 3, d + 1).
    """

    sample: int
    solve: Callable[[Array, Array], Array]


HOMOGRAPHY = Map(4, lambda x, u: homography.homographies(x, u, steps=0))
PROJECTION = Map(6, lambda x, u: dlt.projection_matrices(x, u))


def lengths(matrices: Array, points: Array, uv: Array) -> Array:
    """Reprojection errors (H, N), px, of points (N, d) under matrices (H, 3, d + 1); inf at infinity."""
    with np.errstate(all="ignore"):
        q = projective.homogeneous(points) @ np.swapaxes(matrices, -1, -2)
        error = np.linalg.norm(q[..., :2] / q[..., 2:] - uv, axis=-1)
    return np.where(np.isfinite(error), error, np.inf)


def agreeing(
    points: Array,
    uv: Array,
    kind: Map,
    rng: np.random.Generator,
    confidence: float = 0.999,
    inliers: float = 0.55,
) -> tuple[Array, float]:
    """The points (N, d) that agree with the map on which most of them agree.

    Parameters
    ----------
    points : (N, d) array
    uv : (N, 2) array, px
    kind : Map
    confidence : float
        Probability that at least one sample is free of outliers, given
    inliers : float
        the least share of good points that is provided for. The median breaks down below one half.

    Returns
    -------
    mask : (N,) bool array
    sigma : float
        Scatter of one coordinate about the map, px: noise and what the map does not explain.
    """
    n = len(points)
    if n < 2 * kind.sample:
        return np.ones(n, bool), float("nan")
    wanted = int(np.ceil(np.log(1 - confidence) / np.log(1 - inliers**kind.sample)))
    best, best_median = np.ones(n, bool), np.inf
    for begin in range(0, wanted, _BATCH):
        count = min(_BATCH, wanted - begin)
        picks = np.argsort(rng.random((count, n)), axis=1)[:, : kind.sample]
        medians = np.median(lengths(_solve(kind, points[picks], uv[picks]), points, uv), axis=1)
        order = np.argsort(medians)[:3]
        for h in order:
            if medians[h] > 1.5 * best_median:
                break
            mask, median = _optimise(points, uv, kind, picks[h])
            if median < best_median:
                best, best_median = mask, median
    return best, _sigma(best_median, n, kind)


def _solve(kind: Map, points: Array, uv: Array) -> Array:
    with np.errstate(all="ignore"):
        return np.nan_to_num(kind.solve(points, uv), nan=0.0, posinf=0.0, neginf=0.0)


def _sigma(median: float, n: int, kind: Map) -> float:
    """Rousseeuw's scale with his correction for small samples."""
    return max((1 + 5 / max(n - kind.sample, 1)) * median / RAYLEIGH_MEDIAN, _FLOOR)


def _optimise(points: Array, uv: Array, kind: Map, rows: Array) -> tuple[Array, float]:
    """Fit to the sample, then to what agrees with it, a few times; the last mask and the least median."""
    mask, least = np.ones(len(points), bool), np.inf
    for _ in range(4):
        error = lengths(_solve(kind, points[rows][None], uv[rows][None]), points, uv)[0]
        median = float(np.median(error))
        if median >= least:
            break
        least = median
        mask = error <= _REACH * _sigma(median, len(points), kind)
        rows = np.flatnonzero(mask)
        if len(rows) < kind.sample:
            break
    return mask, least


def agreeing_views(views: Sequence[View], planar: Sequence[bool], seed: int = 0) -> list[Array]:
    """Masks (N,) of the points of each view that agree with one homography, or one projection matrix.

    Parameters
    ----------
    views : sequence of View
    planar : sequence of bool
        Which views hold points of a plane; they are taken in the coordinates of their best plane.
    seed : int
        The same seed gives the same masks.
    """
    rng = np.random.default_rng(seed)
    masks = []
    for view, flat in zip(views, planar, strict=True):
        points, kind = view.xyz, PROJECTION
        if flat:
            origin, axes, _ = projective.fit_plane(view.xyz)
            points, kind = (view.xyz - origin) @ axes[:, :2], HOMOGRAPHY
        masks.append(agreeing(points, view.uv, kind, rng)[0])
    return masks
