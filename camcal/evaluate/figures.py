"""Every definition of an error figure, in one place.

With residuals r_i (predicted - observed, px) of the N points that a solution rests on, and p free parameters
(poses included):

    rms_point = sqrt(Σ |r_i|² / N)            what cv2 and Zhang print                             (1)
    rms_coord = sqrt(Σ |r_i|² / 2N)           mrcal's                                              (2)
    sigma_hat = sqrt(Σ |r_i|² / (2N - p))     estimated standard deviation of a coordinate, px     (3)
    sigma_0   = sqrt(Σ w_i |r_i|² / (2N - p)) with w_i = 1 / sigma_i²; scales the covariance       (4)

median, p95 and max are those of the lengths |r_i|. Without given sigmas w_i = 1 and (4) is (3). With them
sigma_0 is a pure number, the factor by which the given sigmas are too small (photogrammetry's standard error
of unit weight).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camcal.types import Solution

Array = np.ndarray


@dataclass(frozen=True)
class Figures:
    """The figures of a set of residuals, px; NaN where the set is empty."""

    points: int
    rms_point: float
    rms_coord: float
    median: float
    p95: float
    max: float


def of(residuals: Array) -> Figures:
    """The figures (1), (2), median, p95 and max of residuals (N, 2), px."""
    n = len(residuals)
    if n == 0:
        return Figures(0, *[float("nan")] * 5)
    squares = np.einsum("ij,ij->i", residuals, residuals)
    mean = float(squares.mean())
    lengths = np.sqrt(squares)
    median, p95 = np.percentile(lengths, [50, 95]).tolist()
    return Figures(n, mean**0.5, (mean / 2) ** 0.5, median, p95, float(lengths.max()))


def rms_point(residuals: Array) -> float:
    """Equation (1) of residuals (..., 2), px; NaN without points."""
    r = np.reshape(residuals, (-1, 2))
    return float(np.sqrt(np.einsum("ij,ij->", r, r) / len(r))) if len(r) else float("nan")


def redundancy(solution: Solution) -> int:
    """2N - p: observed coordinates less free parameters; the degrees of freedom of the residuals."""
    return 2 * sum(int(m.sum()) for m in solution.inliers) - solution.free_count


def sigma_hat(solution: Solution) -> float:
    """Equation (3), px; NaN where the redundancy is not positive."""
    return _per_redundancy(solution, np.square(solution.used_residuals).sum())


def sigma_0(solution: Solution) -> float:
    """Equation (4); NaN where the redundancy is not positive."""
    total = 0.0
    for view, r, used in zip(
        solution.correspondences.views, solution.residuals, solution.inliers, strict=True
    ):
        scaled = r if view.sigma is None else r / view.sigma[:, None]
        total += float(np.square(scaled[used]).sum())
    return _per_redundancy(solution, total)


def _per_redundancy(solution: Solution, squares: float) -> float:
    freedom = redundancy(solution)
    return float(np.sqrt(squares / freedom)) if freedom > 0 else float("nan")


def overall(solution: Solution) -> Figures:
    """The figures of the points the solution rests on."""
    return of(solution.used_residuals)


def per_view(solution: Solution) -> list[Figures]:
    """The figures of each view, over its used points."""
    return [of(r[used]) for r, used in zip(solution.residuals, solution.inliers, strict=True)]
