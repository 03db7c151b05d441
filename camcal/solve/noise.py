"""How far given sigmas tell of the residuals: their scale, and what they leave out.

The sigma of a corner fit knows the picture's noise, not the board's print nor the lens model's faults.
Taken as it is, it gives the sharpest pictures nearly all the weight although all are equally far from the
model. Two variance components mend that:

    σ_i² = κ² s_i² + τ²                                                                                (1)

with s_i as given, by maximum likelihood over the residuals (Rayleigh distributed lengths),

    minimise  Σ_i log σ_i² + |r_i|² / 2 σ_i²                                                           (2)

(Searle, Casella & McCulloch, Variance Components, 1992). τ = 0 is the usual reading of given sigmas, up to a
common scale; κ = 0 says that they tell nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from camcal.model.pose import Array
from camcal.solve.calibration import Calibration
from camcal.solve.losses import robust_sigma

#: residuals beyond this many σ of all points are left out of (2): outliers would pass for τ
_REACH = 4.0
#: τ, or κ s, below this part of the other is as good as 0
_NOTHING = 1e-3


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
    """
    s, r = given[calibration.used], calibration.used_residuals
    squares = np.einsum("ij,ij->i", r, r) * (2 * len(r) / max(2 * len(r) - calibration.free_count, 1))
    usual = robust_sigma(np.sqrt(squares))
    keep = np.isfinite(squares) & (squares <= (_REACH * usual) ** 2 * 2)
    s, squares = s[keep], squares[keep]
    middle = float(np.median(s))

    def unlikelihood(logs: Array) -> float:
        variance = (np.exp(logs[0]) * s / middle) ** 2 + np.exp(2 * logs[1])
        return float(np.sum(np.log(variance) + squares / (2 * variance)))

    starts = [np.log([usual * a, usual * b]) for a, b in ((0.99, 0.1), (0.7, 0.7), (0.1, 0.99))]
    found = [minimize(unlikelihood, start, method="Nelder-Mead", options={"xatol": 1e-4}) for start in starts]
    scale, floor = np.exp(min(found, key=lambda f: f.fun).x)
    if floor < _NOTHING * scale:
        floor = 0.0
    if scale < _NOTHING * floor:
        scale = 0.0
    return NoiseModel(float(scale / middle), float(floor))
