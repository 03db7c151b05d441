"""The standard deviation of the image points, given or estimated from residuals that no camera explains."""

from __future__ import annotations

import math
from typing import ClassVar

from scipy.special import chdtrc, fdtrc

from camcal.track.keep import Kept

#: degrees of freedom after which old frames are forgotten: 1 % of standard deviation
MEMORY = 5000.0
LARGEST = 700.0  #: exponent; beyond 709 the exponential is no float64
#: px; data without noise are not weighted higher than this
FLOOR = 1e-6


def gate(probability: float, dof: float) -> float:
    """The squared length that a two-dimensional normal residual, in sigmas, exceeds with a probability.

    Twice the quantile of F(2, dof), which has a closed form: a sigma that rests on few degrees of freedom
    may be much too small. It tends to -2 log(probability).
    """
    if dof <= 0:
        return math.inf
    if math.isinf(dof):
        return -2.0 * math.log(probability)
    power = -2.0 / dof * math.log(probability)
    return dof * math.expm1(power) if power < LARGEST else math.inf


class Noise(Kept):
    """Pooled variance of the residuals of each frame's own best camera.

    This part of a frame is independent of whether, and how well, the camera is tracked, so that the figure
    stays true while the camera moves.

    Attributes
    ----------
    sigma : float
        px; a factor where points bring their own sigmas.
    dof : float
        Degrees of freedom that it rests on; inf where it is known.
    """

    kept: ClassVar[tuple[str, ...]] = ("known", "sigma", "dof")

    def __init__(self, known: float | None = None):
        self.known = known
        self.sigma = known if known is not None else 1.0
        self.dof = float("inf") if known is not None else 0.0

    def add(self, squares: float, dof: int) -> None:
        """Pool a sum of squared residuals, px² (or in units of the sigmas), of `dof` degrees of freedom."""
        if self.known is not None or dof <= 0:
            return
        total = self.sigma**2 * self.dof + squares
        self.sigma = max((total / (self.dof + dof)) ** 0.5, FLOOR)
        self.dof = min(self.dof + dof, MEMORY)

    def gate(self, probability: float) -> float:
        """The squared distance, in sigmas, that an inlier exceeds with a probability; see `gate`."""
        return gate(probability, self.dof)

    def tail(self, squares: float, dof: int) -> float:
        """The probability that a sum of `dof` squares, in units of `sigma`, is at least this large."""
        if dof <= 0:
            return 1.0
        if math.isinf(self.dof):
            return float(chdtrc(dof, squares))
        return float(fdtrc(dof, self.dof, squares / dof))
