"""How well given sigmas describe the residuals: a scale factor and an additional variance.

The sigma of a corner fit accounts for the picture's noise, not for errors of the board's print or the lens model.
Used directly, it gives nearly all weight to the sharpest pictures although all deviate equally from the model. Two
variance components correct this:

    σ_i² = κ² s_i² + τ²                                                                                (1)

with s_i as given, by maximum likelihood over the residuals (Rayleigh distributed lengths),

    minimise  -log L = Σ_i log σ_i² + |r_i|² / 2 σ_i²                                                  (2)

(Searle, Casella & McCulloch, Variance Components, 1992). τ = 0 is the usual interpretation of given sigmas,
up to a common scale, and is kept unless the residuals contradict it: 2 (log L(κ, τ) - log L(κ, 0)), which follows half
a χ² of one degree of freedom if τ is 0 (Self & Liang, JASA 82, 1987, case 5), must exceed `EVIDENCE`.
"""

from __future__ import annotations

import numpy as np

from camcal.geometry.numbers import median
from camcal.model.pose import Array
from camcal.records import dataclass
from camcal.solve.calibration import Calibration
from camcal.solve.losses import robust_sigma

#: residuals beyond this many σ, both in px and in given sigmas, are excluded from (2): outliers would increase τ
_REACH = 4.0
#: κ s below this fraction of τ is treated as 0; τ is 0 unless the residuals contradict it
_NOTHING = 1e-3
#: scoring ends where a step gains less of (2) than this, a ten-thousandth of `EVIDENCE`, or after so many steps, each
#: a factor of e at most
_SETTLED, _STEPS = 1e-6, 60
#: of a thousand sets with correct sigmas, one gets an additional variance: the square of the standard normal quantile
#: of 0.001, which half a χ² of one degree of freedom exceeds with that probability
EVIDENCE = 9.549536


@dataclass(frozen=True)
class NoiseModel:
    """κ (dimensionless) and τ (px) of equation (1)."""

    scale: float
    floor: float

    def sigmas(self, given: Array) -> Array:
        """σ (N,), px, for given sigmas (N,)."""
        return np.sqrt((self.scale * given) ** 2 + self.floor**2)


def noise_model(calibration: Calibration, given: Array) -> NoiseModel:
    """Estimate (1) from the residuals of a fit and the sigmas (N,) that were given for its rows.

    The residuals are enlarged for the parameters that were fitted to them, by sqrt(2N / (2N - p)).

    Parameters
    ----------
    calibration : Calibration
        A fit with weights close to the result: without weights, errors of the camera caused by the other points appear
        in the residuals of the sharpest points and would increase τ.
    given : (N,) array, px
    """
    s, r = given[calibration.used], calibration.used_residuals
    squares = np.einsum("ij,ij->i", r, r) * (2 * len(r) / max(2 * len(r) - calibration.free_count, 1))
    with np.errstate(invalid="ignore"):
        near = [x <= (_REACH * robust_sigma(np.sqrt(x))) ** 2 * 2 for x in (squares, squares / s**2)]
    keep = np.isfinite(squares) & (near[0] | near[1])
    s, squares = s[keep], squares[keep]
    middle, usual = median(s), robust_sigma(np.sqrt(squares))

    # τ = 0: the best κ² is the mean of |r|² / 2 s²
    alone = float(np.sqrt(np.mean(squares / (2 * s**2))))
    if not (
        alone > 0 and usual > 0
    ):  # most points fit without any error: their residuals say nothing about it
        return NoiseModel(1.0, 0.0)
    believed = float(np.sum(np.log((alone * s) ** 2)) + len(s))
    starts = [np.log([usual * a, usual * b]) for a, b in ((0.99, 0.1), (0.7, 0.7), (0.1, 0.99))]
    best, logs = min((_likeliest(start, s / middle, squares) for start in starts), key=lambda f: f[0])
    if not 2 * (believed - best) > EVIDENCE:
        return NoiseModel(alone, 0.0)
    scale, floor = np.exp(logs)
    if scale < _NOTHING * floor:
        scale = 0.0
    return NoiseModel(float(scale / middle), float(floor))


def _likeliest(logs: Array, s: Array, squares: Array) -> tuple[float, Array]:
    """The minimum of (2) and the logarithms (2,) of κ and τ there, by Fisher scoring with steps of at most 1."""

    def unlikelihood(logs: Array) -> tuple[float, Array, Array]:
        parts = np.exp(2 * logs)[:, None] * np.stack([s * s, np.ones_like(s)])
        variance = parts.sum(0)
        return float((np.log(variance) + squares / (2 * variance)).sum()), parts, variance

    damping, (value, parts, variance) = 1e-6, unlikelihood(logs)
    for _ in range(_STEPS):
        share = 2 * parts / variance  # ∂ log σ² / ∂ logs
        gradient = share @ (1 - squares / (2 * variance))
        information = share @ share.T
        information[[0, 1], [0, 1]] *= 1 + damping
        step = -np.linalg.lstsq(information, gradient, rcond=None)[0]
        tried = logs + step / max(1.0, float(np.abs(step).max()))
        new = unlikelihood(tried)
        if new[0] <= value:
            settled = value - new[0] < _SETTLED
            logs, damping, (value, parts, variance) = tried, damping / 10, new
            if settled:
                break
        else:
            damping *= 10
    return value, logs
