"""Every definition of an error figure.

With residuals r_i (predicted - observed, px) of the N points that a solution rests on, and p free parameters
(poses included):

    rms_point = sqrt(Σ |r_i|² / N)            what cv2 and Zhang print                             (1)
    rms_coord = sqrt(Σ |r_i|² / 2N)           mrcal's                                              (2)
    sigma_hat = sqrt(Σ |r_i|² / (2N - p))     estimated standard deviation of a coordinate, px     (3)
    sigma_0   = sqrt(Σ w_i |r_i|² / (2N - p)) with w_i = 1 / sigma_i²; scales the covariance       (4)

median, p95 and max are those of the lengths |r_i|. Without given sigmas w_i = 1 and (4) is (3). With them
sigma_0 is a pure number, the factor by which the given sigmas are too small (photogrammetry's standard error
of unit weight). A robust loss weights each point once more, by v_i from its length in units of sigma_i, l_i;
the covariance of such an estimate is (Huber, Robust Statistics, 1981, section 7.6, for residuals of two
coordinates)

    sigma_0² = mean(v) Σ v_i² l_i² / (2N - p) / mean(v + ½ l dv/dl)²                              (5)

over the normal matrix that has the v_i in it; with v = 1 this is (4).
"""

from __future__ import annotations

import numpy as np

from camcal.geometry.numbers import percentiles
from camcal.records import dataclass
from camcal.solve.calibration import Estimate
from camcal.solve.losses import LOSSES, robust_sigma

Array = np.ndarray

#: relative step of the central difference in (5); a loss has kinks, so that more digits are useless
_STEP = 1e-5


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
    median, p95 = percentiles(lengths, (50, 95))
    return Figures(n, mean**0.5, (mean / 2) ** 0.5, median, p95, float(lengths.max()))


def rms_point(residuals: Array) -> float:
    """Equation (1) of residuals (..., 2), px; NaN without points."""
    r = np.reshape(residuals, (-1, 2))
    return float(np.sqrt(np.einsum("ij,ij->", r, r) / len(r))) if len(r) else float("nan")


def ranked(value: float | None) -> float:
    """A figure for a ranking in which smaller is better: inf if it is missing or NaN.

    Comparisons with NaN are all false, so that one NaN upsets any sort, min or max.
    """
    return float("inf") if value is None or np.isnan(value) else float(value)


def redundancy(solution: Estimate) -> int:
    """2N - p: observed coordinates minus free parameters; the degrees of freedom of the residuals."""
    return 2 * int(solution.used.sum()) - solution.free_count


def sigma_hat(solution: Estimate) -> float:
    """Equation (3), px; NaN where the redundancy is not positive."""
    return _per_redundancy(solution, np.square(solution.used_residuals).sum())


def sigma_0(solution: Estimate) -> float:
    """Equation (4), or (5) after a robust loss; NaN where the redundancy is not positive."""
    lengths = standard_lengths(solution)
    if solution.observations.weight is None:
        return _per_redundancy(solution, float(lengths @ lengths))
    weights = solution.observations.weight[solution.used]
    loss = LOSSES[solution.fit.loss]
    u = lengths / (loss.constant * robust_sigma(lengths, solution.free_count))
    slope = (loss.weight(u * (1 + _STEP)) - loss.weight(u * (1 - _STEP))) / (2 * _STEP)
    bread = float(np.mean(weights + slope / 2))
    if not bread > 0:
        return float("nan")
    squares = float(np.square(weights * lengths).sum())
    return _per_redundancy(solution, weights.mean() * squares) / bread


def standard_lengths(solution: Estimate) -> Array:
    """Lengths (N,) of the residuals of the used points, each in units of its given sigma (otherwise px)."""
    return solution.observations.standardised(solution.residuals)[solution.used]


def _per_redundancy(solution: Estimate, squares: float) -> float:
    freedom = redundancy(solution)
    return float(np.sqrt(squares / freedom)) if freedom > 0 else float("nan")


def overall(solution: Estimate) -> Figures:
    """The figures of the points used by the solution."""
    return of(solution.used_residuals)


def per_view(solution: Estimate) -> list[Figures]:
    """The figures of each view, over its used points."""
    kept = solution.observations.kept()
    return [of(r) for r in kept.split(solution.used_residuals)]


def rms_of_views(solution: Estimate) -> Array:
    """rms_point (V,) of each view, px; NaN for one without used points."""
    data = solution.observations
    squares = np.where(solution.used, np.square(solution.residuals).sum(1), 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.sqrt(data.per_block(squares) / data.per_block(solution.used))
