"""Gains: the fraction of a frame's own correction that is applied.

A frame reduces to z = A δ + noise of unit variance, δ being the error of the prediction (linear.compress);
the estimate moves by G z. The covariance that goes with *any* G is Joseph's (linear.joseph), so that the
uncertainty stays consistent whichever gain is chosen.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from camcal.settings.tracking import TrackOptions
from camcal.track import linear
from camcal.track.keep import Kept

Array = np.ndarray


class Gain(Kept):
    """A rule for G; the base class is Kalman's, of minimum variance.

    Attributes
    ----------
    tracks_velocity : bool
        Whether it can move state variables that no frame measures.
    """

    tracks_velocity = True

    def __init__(self, options: TrackOptions):
        self.options = options

    def begin(self, factor: Array) -> None:
        """Start from an estimate with covariance factor (n, n): at the first frame and after a change."""
        del factor

    def inflate(self, factor: Array, a: Array, z: Array) -> Array:
        """The predicted factor that the gain uses; most gains leave it unchanged."""
        del a, z
        return factor

    def __call__(self, factor: Array, a: Array, innovation: Array, step: float) -> Array:
        """The matrix G (n, p).

        Parameters
        ----------
        factor : (n, n) array
            L of the predicted covariance.
        a : (p, p) array
        innovation : (p, p) array
            Lower Cholesky factor of S = A P Aᵀ + I.
        step : float
            Frames since the last one.
        """
        return kalman(factor, a, innovation)


def kalman(factor: Array, a: Array, innovation: Array) -> Array:
    """P Aᵀ S⁻¹ (Kalman 1960)."""
    cross = (a @ factor[: len(a)]) @ factor.T
    return linear.solve_factored(innovation, cross).T


class ForgettingGain(Gain):
    """Exponentially weighted least squares: G = (Σ λᵏ AᵀA)⁻¹ Aᵀ, the sum stored as a triangular factor by QR.

    Björck, Numerical Methods for Least Squares Problems (1996), section 3.3: nothing is ever squared or
    subtracted, so that rounding errors do not build up over any number of frames.
    """

    tracks_velocity = False
    kept: ClassVar[tuple[str, ...]] = ("root",)

    def __init__(self, options: TrackOptions):
        super().__init__(options)
        self.forgetting = options.forgetting
        self.root = np.zeros((0, 0))

    def begin(self, factor: Array) -> None:
        """Start with the information of the estimate as the sum."""
        self.root = linear.triangle(np.ascontiguousarray(np.linalg.inv(factor).T)).T

    def __call__(self, factor: Array, a: Array, innovation: Array, step: float) -> Array:
        """See `Gain`."""
        p = len(a)
        rows = np.empty((p, 2 * p))
        rows[:, :p] = self.root.T * self.forgetting ** (0.5 * step)
        rows[:, p:] = a.T
        self.root = linear.triangle(rows).T
        half = linear.solve_upper(self.root, a.T, transposed=True)
        return linear.solve_upper(self.root, half)


class MeanGain(ForgettingGain):
    """The mean over all points so far with equal weights: nothing is forgotten.

    The paper's theorem, Column(M) = E{CᵀC}⁻¹ E{CᵀY}, with its expectation taken over the points of all
    frames since the start or the last change.
    """

    def __init__(self, options: TrackOptions):
        super().__init__(options)
        self.forgetting = 1.0


class FixedGain(Gain):
    """G = α A⁻¹: a constant fraction α of the way to the frame's own least-squares estimate."""

    tracks_velocity = False

    def __call__(self, factor: Array, a: Array, innovation: Array, step: float) -> Array:
        """See `Gain`; directions that the frame does not determine are unchanged."""
        return self.options.alpha * np.linalg.pinv(a, rcond=linear.UNDETERMINED)


class AdaptiveGain(Gain):
    """The Kalman gain with the covariance inflated by the ratio of observed to predicted innovations.

    An adaptive fading memory (Xia, Rao, Ying & Shen, Automatica 30, 1994): the mean of zᵀz / p over the last
    frames is 1 + tr(A P Aᵀ) / p while the motion is as stated; P is multiplied by what is missing
    beyond two standard deviations of that mean.
    """

    kept: ClassVar[tuple[str, ...]] = ("mean", "weight")
    #: frames over which the innovations are averaged
    MEMORY = 10.0

    def __init__(self, options: TrackOptions):
        super().__init__(options)
        self.mean, self.weight = 0.0, 0.0

    def begin(self, factor: Array) -> None:
        """Discard the innovations before the change."""
        self.mean, self.weight = 0.0, 0.0

    def inflate(self, factor: Array, a: Array, z: Array) -> Array:
        """See `Gain`."""
        p = len(a)
        keep = 1.0 - 1.0 / self.MEMORY
        self.weight = keep * self.weight + 1.0
        self.mean += (float(z @ z) / p - self.mean) / self.weight
        predicted = float(np.einsum("ij,ij->", af := a @ factor[:p], af)) / p
        if predicted <= 0:
            return factor
        # variance of an exponential mean of chi-squared variables over p, relative to its expectation
        spread = (1 + predicted) * np.sqrt(2.0 / p / self.weight)
        surplus = self.mean - 1.0 - 2.0 * spread
        return factor * np.sqrt(max(1.0, surplus / predicted))
