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

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from camcal.data.observations import Correspondences
from camcal.model.pose import Array
from camcal.solve.losses import robust_sigma
from camcal.solve.solution import Solution

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


def noise_model(solution: Solution, given: Mapping[str, Array]) -> NoiseModel:
    """Estimate (1) from the residuals of a solution and the sigmas (N,) that were given for its views, by id.

    The residuals are enlarged for the parameters that were fitted to them, by sqrt(2N / (2N - p)).
    """
    views = solution.correspondences.views
    s = np.concatenate([given[v.id][m] for v, m in zip(views, solution.inliers, strict=True)])
    r = solution.used_residuals
    squares = np.einsum("ij,ij->i", r, r) * (2 * len(r) / max(2 * len(r) - solution.free_count, 1))
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


def with_model(correspondences: Correspondences, model: NoiseModel) -> Correspondences:
    """The correspondences with the sigmas of the model in place of the given ones."""
    views = tuple(
        v if v.sigma is None else replace(v, sigma=model.sigmas(v.sigma)) for v in correspondences.views
    )
    return replace(correspondences, views=views)


def unweighted(correspondences: Correspondences) -> Correspondences:
    """The correspondences without sigmas."""
    return replace(correspondences, views=tuple(replace(v, sigma=None) for v in correspondences.views))
