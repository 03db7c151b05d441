"""Robust losses by name, as weights of iteratively reweighted least squares.

A loss acts on the length of a point's residual vector, u = |r| / (c σ), with weight w(u) = ρ'(u) / u
(Holland & Welsch 1977; Zhang, Parameter estimation techniques, 1997, table 1). The constants c give an
asymptotic efficiency of 95 % on Gaussian noise in *two* coordinates: with E over the Rayleigh distribution of
|r| / σ,

    efficiency = E[w + ½ |r| w']² / ½ E[w² |r|²] = 0.95                                                  (1)

They differ from the usual ones, which hold for scalar residuals.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from camcal.geometry.numbers import median
from camcal.model.pose import Array
from camcal.records import dataclass


@dataclass(frozen=True)
class Loss:
    """A loss: `weight` of u >= 0, and the constant c of (1)."""

    name: str
    weight: Callable[[Array], Array]
    constant: float

    def weights(self, lengths: Array, sigma: float) -> Array:
        """Weights of points with residuals of these lengths; σ is the standard deviation of one coordinate."""
        return self.weight(lengths / (self.constant * max(sigma, np.finfo(float).tiny)))


LOSSES = {
    loss.name: loss
    for loss in (
        Loss("linear", lambda u: np.ones_like(u), 1.0),
        Loss("huber", lambda u: 1.0 / np.maximum(u, 1.0), 1.501141),
        Loss("soft-l1", lambda u: 1.0 / np.sqrt(1.0 + u * u), 1.309427),
        Loss("cauchy", lambda u: 1.0 / (1.0 + u * u), 2.548638),
        Loss("tukey", lambda u: np.where(u < 1.0, (1.0 - np.minimum(u, 1.0) ** 2) ** 2, 0.0), 5.122986),
        Loss("geman-mcclure", lambda u: 1.0 / (1.0 + u * u) ** 2, 4.095552),
    )
}

#: the median of |r| for Gaussian noise of σ = 1 in both coordinates: sqrt(2 ln 2), Rayleigh
RAYLEIGH_MEDIAN = 1.1774100225154747


def robust_sigma(lengths: Array, parameters: int = 0) -> float:
    """σ of one coordinate from the median length of the residuals (a MAD about zero).

    Parameters
    ----------
    lengths : (N,) array
    parameters : int
        Number of parameters fitted to them: the residuals are shorter than the noise by sqrt(1 - p / 2N).
    """
    lengths = lengths[np.isfinite(lengths)]
    if not len(lengths):
        return float("nan")
    freedom = max(2 * len(lengths) - parameters, 1) / (2 * len(lengths))
    return float(median(lengths) / RAYLEIGH_MEDIAN / np.sqrt(freedom))
