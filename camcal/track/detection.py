"""Detection of changes of the camera: two tests on the innovations, with a stated false-alarm rate.

The innovation of a frame, reduced to what a change of the camera's p parameters can explain, gives the
normalised innovation squared (NIS): chi-squared with p degrees of freedom while the camera does what the
motion says (Bar-Shalom, Li & Kirubarajan 2001, section 5.4); p times an F(p, ν) variable where the noise is
estimated with ν degrees of freedom. It is turned into the standard normal deviate of the same
probability, so that frames with different numbers of points can be added up. Then

* a single frame raises the alarm where the deviate exceeds a limit (a knock), and
* so does Page's cumulative sum  s = max(0, s + deviate - 1/2)  above a threshold (what is too small for one
  frame to show; Page, Biometrika 41, 1954).

Each of the two gets half of the stated rate. The threshold of the sum comes from its mean time to a false
alarm, which solves an integral equation (Page 1954; Brook & Evans, Biometrika 59, 1972).
"""

from __future__ import annotations

from functools import lru_cache
from typing import ClassVar

import numpy as np
from scipy.optimize import brentq
from scipy.special import chdtrc, fdtrc, ndtr, ndtri

from camcal.track.keep import Kept

#: the shift of the deviate, in standard deviations, that the sum is quickest for is twice this
REFERENCE = 0.5
#: rates below which the threshold grows by 1 for each factor e (Siegmund, Sequential Analysis 1985), and the
#: equations of the mean time become singular to working precision
EXPONENTIAL = 1e-10
#: beyond this the probability underflows; any limit lies far below
LARGEST = 37.0
#: the least threshold (mean time to an alarm of one frame), and how exactly thresholds are solved for
LOWEST, SOLVED = 1e-3, 1e-6
#: nodes of the integral of the mean time, by Gauss and Legendre: four to a standard deviation of the largest threshold
#: that is solved for, 21. Of a time of 1e10 frames, 40 leave 1e-4 and 20 are of no use
NODES = 80


def normal_deviate(nis: float, dof: int, noise_dof: float) -> float:
    """The standard normal deviate with the same tail probability as `nis`.

    Parameters
    ----------
    nis : float
    dof : int, p
    noise_dof : float
        Degrees of freedom of the estimated noise; inf where it is known.
    """
    if np.isinf(noise_dof):
        tail = chdtrc(dof, nis)
    else:
        tail = fdtrc(dof, noise_dof, nis / dof)
    return float(min(-ndtri(tail), LARGEST)) if tail > 0 else LARGEST


def mean_time_to_alarm(threshold: float, shift: float = 0.0, nodes: int = NODES) -> float:
    """The mean number of frames until the cumulative sum, starting from zero, crosses its threshold.

    Solves L(s) = 1 + Φ(k - s - μ) L(0) + ∫ φ(x - s + k - μ) L(x) dx over (0, h), Gauss-Legendre (Nyström).

    Parameters
    ----------
    threshold : float, h
    shift : float, μ
        Mean of the deviates; 0 while nothing has changed.
    """
    x, weight = np.polynomial.legendre.leggauss(nodes)
    x, weight = (x + 1) * threshold / 2, weight * threshold / 2
    start = np.concatenate([[0.0], x])
    kernel = np.empty((nodes + 1, nodes + 1))
    kernel[:, 0] = ndtr(REFERENCE - shift - start)
    step = x[None] - start[:, None] + REFERENCE - shift
    kernel[:, 1:] = np.exp(-0.5 * step**2) / np.sqrt(2 * np.pi) * weight
    return float(np.linalg.solve(np.eye(nodes + 1) - kernel, np.ones(nodes + 1))[0])


@lru_cache(maxsize=16)
def cusum_threshold(false_alarm: float) -> float:
    """The threshold with one false alarm in 1 / false_alarm frames on average."""
    if false_alarm < EXPONENTIAL:
        return cusum_threshold(EXPONENTIAL) + float(np.log(EXPONENTIAL / false_alarm))
    wanted = np.log(1 / false_alarm)

    def excess(threshold: float) -> float:
        return float(np.log(mean_time_to_alarm(threshold)) - wanted)

    high = 1.0  # far above the answer the equations are singular to working precision, so it is approached
    while excess(high) < 0:
        high += 1.0
    low = max(high - 1.0, LOWEST)
    return float(brentq(excess, low, high, xtol=SOLVED)) if excess(low) < 0 else low


class ChangeTest(Kept):
    """Both tests, frame by frame.

    Attributes
    ----------
    limit, threshold : float
        Of the single deviate and of the sum.
    sum : float
    since : int or None
        The frame after which the sum was last zero: where a change that it finds began.
    """

    kept: ClassVar[tuple[str, ...]] = ("sum", "since")

    def __init__(self, false_alarm: float):
        self.limit = float(-ndtri(false_alarm / 2))
        self.threshold = cusum_threshold(false_alarm / 2)
        self.sum = 0.0
        self.since: int | None = None

    def step(self, frame: int, score: float, allowance: float = 0.0) -> str | None:
        """Process a frame's deviate; return the test that raises an alarm, `nis` or `cusum`, or None.

        Parameters
        ----------
        allowance : float
            What all deviates may have in common by mistake; the sum leaves it out.
        """
        self.sum = max(0.0, self.sum + score - REFERENCE - allowance)
        if self.sum == 0.0:
            self.since = None
        elif self.since is None:
            self.since = frame
        if score > self.limit:
            return "nis"
        return "cusum" if self.sum > self.threshold else None

    def reset(self) -> None:
        """Restart after an alarm."""
        self.sum, self.since = 0.0, None
