"""How far given sigmas tell of the residuals: their scale, and what they leave out.

The sigma of a corner fit knows the picture's noise, not the board's print nor the lens model's faults.
Taken as it is, it gives the sharpest pictures nearly all the weight although all are equally far from the
model. Two variance components mend that:

    σ_i² = κ² s_i² + τ²                                                                                (1)

with s_i as given, by maximum likelihood over the residuals (Rayleigh distributed lengths),

    minimise  -log L = Σ_i log σ_i² + |r_i|² / 2 σ_i²                                                  (2)

(Searle, Casella & McCulloch, Variance Components, 1992). τ = 0 is the usual reading of given sigmas, up to a
common scale, and is what holds unless the residuals speak against it: 2 (log L(κ, τ) - log L(κ, 0)), which follows
half a χ² of one degree of freedom where τ is 0 (Self & Liang, JASA 82, 1987, case 5), has to exceed `EVIDENCE`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from camcal.model.pose import Array
from camcal.solve.calibration import Calibration
from camcal.solve.losses import robust_sigma

#: residuals beyond this many σ, both in px and in given sigmas, are left out of (2): outliers would pass for τ
_REACH = 4.0
#: τ, or κ s, below this part of the other is as good as 0
_NOTHING = 1e-3
#: of a thousand sets whose sigmas are right, one gets a floor
CHANCE = 0.001
EVIDENCE = float(ndtri(CHANCE)) ** 2  # χ² of one degree of freedom is the square of a Gaussian


@dataclass(frozen=True)
class NoiseModel:
    """κ, a pure number, and τ, px, of equation (1)."""

    scale: float
    floor: float

    def sigmas(self, given: Array) -> Array:
        """σ (N,), px, of given sigmas (N,)."""
        return np.sqrt((self.scale * given) ** 2 + self.floor**2)


def noise_model(calibration: Calibration, given: Array) -> NoiseModel:
    """Estimate (1) from the residuals of a fit and the sigmas (N,) that were given for its rows.

    The residuals are enlarged for the parameters that were fitted to them, by sqrt(2N / (2N - p)).

    Parameters
    ----------
    calibration : Calibration
        A fit with weights that are near to what comes out: in one without, the sharpest points carry the errors that
        the others make in the camera, and these pass for τ.
    given : (N,) array, px
    """
    from scipy.optimize import minimize  # takes longer to import than a camera takes to calibrate

    s, r = given[calibration.used], calibration.used_residuals
    squares = np.einsum("ij,ij->i", r, r) * (2 * len(r) / max(2 * len(r) - calibration.free_count, 1))
    with np.errstate(invalid="ignore"):
        near = [x <= (_REACH * robust_sigma(np.sqrt(x))) ** 2 * 2 for x in (squares, squares / s**2)]
    keep = np.isfinite(squares) & (near[0] | near[1])
    s, squares = s[keep], squares[keep]
    middle, usual = float(np.median(s)), robust_sigma(np.sqrt(squares))

    def unlikelihood(logs: Array) -> float:
        variance = (np.exp(logs[0]) * s / middle) ** 2 + np.exp(2 * logs[1])
        return float(np.sum(np.log(variance) + squares / (2 * variance)))

    # τ = 0: the best κ² is the mean of |r|² / 2 s²
    alone = float(np.sqrt(np.mean(squares / (2 * s**2))))
    believed = float(np.sum(np.log((alone * s) ** 2)) + len(s))
    starts = [np.log([usual * a, usual * b]) for a, b in ((0.99, 0.1), (0.7, 0.7), (0.1, 0.99))]
    found = [minimize(unlikelihood, start, method="Nelder-Mead", options={"xatol": 1e-4}) for start in starts]
    best = min(found, key=lambda f: f.fun)
    if not 2 * (believed - best.fun) > EVIDENCE:
        return NoiseModel(alone, 0.0)
    scale, floor = np.exp(best.x)
    if scale < _NOTHING * floor:
        scale = 0.0
    return NoiseModel(float(scale / middle), float(floor))
